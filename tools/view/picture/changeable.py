"""What of a controller can be changed while it runs, as sliders."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from hoap3.protocol.config.dotted_keys import join_key

MOST = 200  # sliders
_UNIT = re.compile(r"\[([^\]]{1,16})\]\s*$")


def sliders(now: object, numbers: object) -> list[dict[str, Any]]:
    """Key, label, bounds, value and unit of each number that can be changed.

    Args:
        now: what it is, as `control/show` has it.
        numbers: what the controller says of each, as `control/about` has it.
    """
    told = (
        {str(each.get("key")): each for each in numbers if isinstance(each, Mapping)}
        if isinstance(numbers, list)
        else {}
    )
    found = []
    for key, value in _flat(now, ()):
        if not _is_figure(value):
            continue
        about = told.get(key, {})
        meaning = str(about.get("meaning", ""))
        unit = _UNIT.search(meaning)
        found.append(
            {
                "key": key,
                "label": _UNIT.sub("", meaning).strip() or key,
                "lower": about.get("lower"),
                "upper": about.get("upper"),
                "value": value,
                "unit": unit[1] if unit else "",
            }
        )
    return found[:MOST]


def _is_figure(value: object) -> bool:
    """Whether it is a number, some numbers, or null, which stands for one."""
    if isinstance(value, list):
        nested = any(isinstance(each, list) for each in value)
        return bool(value) and not nested and all(map(_is_figure, value))
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


def _flat(node: object, path: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Dotted keys of what is no mapping."""
    if isinstance(node, Mapping):
        for key, value in node.items():
            if len(path) < 16:
                yield from _flat(value, (*path, str(key)))
    elif path:
        yield join_key(path), node
