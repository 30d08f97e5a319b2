"""Compare two JSON values key by key."""

from __future__ import annotations

import json
from collections.abc import Iterator
from difflib import SequenceMatcher
from typing import Any

from .difference import Difference


def compare_json(old: Any, new: Any, path: str) -> Iterator[Difference]:
    """Yield every difference; the path of an element of a list holds its index in the old one.

    Elements of lists of different length are matched by their text, so that one more element is
    one difference.
    """
    if isinstance(old, dict) and isinstance(new, dict):
        for key in [*old, *(key for key in new if key not in old)]:
            place = join(path, key)
            if key not in new:
                yield Difference(place, "removed", old=old[key])
            elif key not in old:
                yield Difference(place, "added", new=new[key])
            else:
                yield from compare_json(old[key], new[key], place)
    elif isinstance(old, list) and isinstance(new, list):
        yield from _compare_lists(old, new, path)
    elif is_number(old) and is_number(new):
        if repr(old) != repr(new):
            yield Difference(path, "changed", old, new, abs(float(old) - float(new)))
    elif old != new or type(old) is not type(new):
        yield Difference(path, "changed", old, new)


def _compare_lists(old: list[Any], new: list[Any], path: str) -> Iterator[Difference]:
    if len(old) == len(new):
        for place, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from compare_json(one, other, join(path, place))
        return
    texts = [[json.dumps(each, sort_keys=True) for each in side] for side in (old, new)]
    for tag, i, j, k, m in SequenceMatcher(None, *texts, autojunk=False).get_opcodes():
        if tag == "replace" and j - i == m - k:
            for place in range(i, j):
                yield from compare_json(old[place], new[k + place - i], join(path, place))
        elif tag != "equal":
            for place in range(i, j):
                yield Difference(join(path, place), "removed", old=old[place])
            for place in range(k, m):
                yield Difference(join(path, place), "added", new=new[place])


def join(path: str, key: object) -> str:
    """Path of a key."""
    return f"{path}{'' if path.endswith(':') else '.'}{key}"


def is_number(value: Any) -> bool:
    """Whether a JSON value is a number; booleans are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)
