"""A config's parameters as a log gives them, completed by the defaults of their controller."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


class UnverifiableError(LookupError):
    """A part of a log that cannot be recomputed; its text is the reason."""


NOT_READ = UnverifiableError, AttributeError, KeyError, TypeError, ValueError
"""What settings that cannot be verified raise."""


def reason_of(error: Exception) -> str:
    """Why settings cannot be verified, of one of `NOT_READ`."""
    return str(error) if isinstance(error, UnverifiableError) else f"config: {error!r:.80}"


def complete(
    given: object, defaults: Mapping[str, Any], where: str, *, strict: bool = True
) -> dict[str, Any]:
    """The parameters with their defaults.

    Args:
        given: from the log's config; None is nothing.
        defaults: by key. A type instead of a value, `float` or `str`, has to be given; a tuple of
            choices is one of these, the first by default; an empty tuple is a list of numbers; a
            mapping has defaults of its own; None may be anything.
        where: they stand, for reasons.
        strict: refuse keys without a default.

    Raises:
        UnverifiableError: a key that is not known, or a value that cannot be used.
    """
    if given is None:
        given = {}
    if not isinstance(given, Mapping):
        raise UnverifiableError(f"{where} is {given!r:.40}")
    unknown = {key: value for key, value in given.items() if key not in defaults}
    if unknown and strict:
        raise UnverifiableError(f"{where} has a key {next(iter(unknown))!r:.40}")
    found = dict(unknown)
    for key, usual in defaults.items():
        if isinstance(usual, Mapping):
            found[key] = complete(given.get(key), usual, f"{where}.{key}", strict=strict)
        elif key in given:
            found[key] = _checked(given[key], usual, f"{where}.{key}")
        else:
            found[key] = _usual(usual, where)
    return found


def numbers(given: object, count: int, where: str) -> list[float]:
    """So many finite numbers.

    Raises:
        UnverifiableError: it is something else.
    """
    if not isinstance(given, list | tuple) or len(given) != count or not all(map(is_number, given)):
        raise UnverifiableError(f"{where} is {given!r:.60}")
    return [float(number) for number in given]


def check_least(settings: Mapping[str, Any], key: str, least: float) -> None:
    """Refuse a regularisation that no config may have: tolerances grow with its inverse.

    Raises:
        UnverifiableError: it is less than `least`.
    """
    if not settings[key] >= least:
        raise UnverifiableError(f"parameter {key} is {settings[key]!r:.40}, less than {least:g}")


def is_number(value: object) -> bool:
    """Whether a value is a finite number, and no bool."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _usual(usual: Any, where: str) -> Any:
    if isinstance(usual, type):
        raise UnverifiableError(f"{where} lacks a {usual.__name__}")
    return usual[0] if isinstance(usual, tuple) and usual else usual


def _checked(value: Any, usual: Any, where: str) -> Any:
    if usual is None:
        fits = True
    elif isinstance(usual, tuple):
        fits = value in usual if usual else all(map(is_number, value))
    elif isinstance(usual, bool):
        fits = isinstance(value, bool)
    else:
        kind = usual if isinstance(usual, type) else type(usual)
        fits = is_number(value) if kind is float else isinstance(value, kind)
    if not fits:
        raise UnverifiableError(f"parameter {where} is {value!r:.40}")
    return value
