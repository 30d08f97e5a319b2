"""The final error in words: √(2V) of the last answer, in the unit that its task has, if it has one.

V adds squares of e as the controller has it, in m and rad. So there is a unit where the errors that
the controller told of its tasks have one, and none where lengths and angles are added.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_IN_V = {"deg": "rad"}
"""Units of V, where errors are told to people in others."""


def final_error_words(summary: Mapping[str, Any]) -> str | None:
    """What a summary says of its final error, with a unit or the reason why there is none.

    Args:
        summary: with `final_error` and the `task` that `judge` returns.

    Returns:
        None where there is nothing to tell: without V, and for 0, which is also what a controller
        sends that has none.
    """
    size = summary["final_error"]
    if not size:
        return None
    units = units_of_v(summary)
    if len(units) == 1:
        return f"{size:.3g} {units[0]}"
    without = f"{' and '.join(units)} added" if units else "in the unit of the controller's task"
    return f"{size:.3g} = √(2V), {without}"


def units_of_v(summary: Mapping[str, Any]) -> list[str]:
    """Units of what V adds: one where all tasks have it, none where one is not known.

    Args:
        summary: with the `task` that `judge` returns.
    """
    units = {_IN_V.get(error["unit"], error["unit"]) for error in summary["task"]["errors"]}
    return [] if "" in units else sorted(units)
