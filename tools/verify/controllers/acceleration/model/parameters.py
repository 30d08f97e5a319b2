"""Parameters of a log's config beside their defaults; what is none is named, and not used."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


def filled(given: Mapping[str, Any], defaults: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """All parameters, those that the config does not give by their defaults.

    Args:
        given: as the config has them.
        defaults: by name; a mapping has its own, None is whatever the config has.

    Returns:
        The parameters, and which is none that can be reckoned with, "" for none.
    """
    found: dict[str, Any] = {**defaults, **given}
    for key, usual in defaults.items():
        value, wrong = found[key], ""
        if isinstance(usual, Mapping):
            value = {} if value is None else value
            if isinstance(value, Mapping):
                found[key], wrong = filled(value, usual)
            else:
                wrong = "is no mapping"
        elif not _like(value, usual):
            wrong = f"is {value!r:.40}"
        if wrong:
            return found, f"parameter {key} {wrong}".replace("parameter parameter", "parameter")
    return found, ""


def _like(value: Any, usual: Any) -> bool:
    """Whether a value is of the kind of its default."""
    if usual is None:
        return True
    if isinstance(usual, bool):
        return isinstance(value, bool)
    if isinstance(usual, float):
        return is_number(value)
    if isinstance(usual, tuple):
        return isinstance(value, list | tuple) and all(map(is_number, value))
    return isinstance(value, type(usual))


def is_number(value: Any) -> bool:
    """Whether it is finite, and no bool."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and math.isfinite(value)
