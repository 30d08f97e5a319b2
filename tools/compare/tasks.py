"""Whose task is another than the first controller's: then what V and its error do says nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hoap3.remote_controller.tasks.registry import TaskSettings, check_parameters
from hoap3.tools.compare.series import Series

ALIKE = 0.01  # of V at the start: encoders round, and some controllers go by the reference


def other_tasks(parameters: Sequence[dict[str, Any]], series: Sequence[Series]) -> list[bool]:
    """For each controller whether its task is another than that of the first.

    It is where both name their tasks and these differ, or where V differs at the start, from which
    all set out alike.

    Args:
        parameters: of each controller, defaults included.
        series: what each of them did in closed loop.
    """
    named, starts = [_named(each) for each in parameters], [_start(each) for each in series]
    return [
        task != named[0] if task is not None and named[0] is not None else _unlike(start, starts[0])
        for task, start in zip(named, starts, strict=True)
    ]


def _named(parameters: dict[str, Any]) -> tuple[str, dict[str, Any]] | None:
    """The task that a controller's settings name, with its defaults, or None."""
    given = parameters.get("task")
    if not (isinstance(given, dict) and given.keys() == TaskSettings.model_fields.keys()):
        return None
    task = TaskSettings.model_validate(given)
    whole: dict[str, Any] = check_parameters(task).model_dump(mode="json")
    return task.task, whole


def _start(series: Series) -> float | None:
    """V at the first answer, or None where it is not told."""
    return float(series.lyapunov[0]) if len(series) and series.lyapunov[0] >= 0.0 else None


def _unlike(one: float | None, first: float | None) -> bool:
    if one is None or first is None:
        return False  # then neither V nor an error is there to compare
    return abs(one - first) > ALIKE * max(one, first)
