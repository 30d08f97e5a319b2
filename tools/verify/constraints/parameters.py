"""A config's parameters as a log gives them, completed by the defaults of their controller."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


class UnverifiableError(Exception):
    """What a log claims cannot be recomputed; says why."""


def complete(given: object, defaults: Mapping[str, Any], where: str) -> dict[str, Any]:
    """The parameters with their defaults.

    Args:
        given: from the log's config; None is nothing.
        defaults: by key. A type instead of a value, `float` or `str`, has to be given; a tuple of
            choices is one of these, the first by default; None may be anything.
        where: they stand, for reasons.

    Raises:
        UnverifiableError: a key that is not known, or a value that cannot be reckoned with.
    """
    if given is None:
        given = {}
    if not isinstance(given, Mapping):
        raise UnverifiableError(f"{where} is {given!r:.40}")
    unknown = [key for key in given if key not in defaults]
    if unknown:
        raise UnverifiableError(f"{where} has a key {unknown[0]!r:.40}")
    return {
        key: _checked(given[key], usual, f"{where}.{key}") if key in given else _usual(usual, where)
        for key, usual in defaults.items()
    }


def numbers(given: object, count: int, where: str) -> list[float]:
    """So many finite numbers.

    Raises:
        UnverifiableError: it is something else.
    """
    if not isinstance(given, list | tuple) or len(given) != count or not all(map(_finite, given)):
        raise UnverifiableError(f"{where} is {given!r:.60}")
    return [float(number) for number in given]


def _usual(usual: Any, where: str) -> Any:
    if isinstance(usual, type):
        raise UnverifiableError(f"{where} lacks a {usual.__name__}")
    return usual[0] if isinstance(usual, tuple) else usual


def _checked(value: Any, usual: Any, where: str) -> Any:
    if usual is float or (isinstance(usual, float) and not isinstance(usual, bool)):
        fits = _finite(value)
    elif isinstance(usual, tuple):
        fits = value in usual
    elif usual is str or isinstance(usual, str):
        fits = isinstance(value, str)
    else:
        fits = True
    if not fits:
        raise UnverifiableError(f"parameter {where} is {value!r:.40}")
    return value


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
