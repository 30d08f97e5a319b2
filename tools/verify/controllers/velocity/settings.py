"""Settings of the controllers of several tasks: those of the log's config, else the defaults."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.tools.verify.tasks.targets import UnknownTaskError

Array = NDArray[np.float64]

DEFAULTS: dict[str, Any] = {
    "tasks": None,
    "bounds": {},
    "kinematics_from": "measured",
    "integrate_from": "reference",
    "leave_singularity": False,
}
BOUNDS: dict[str, Any] = {"speed_rad_s": None, "acceleration_rad_s2": None, "margin_rad": 1e-9}
CHOICES = {
    "kinematics_from": ("measured", "reference"),
    "integrate_from": ("measured", "reference"),
}


def settings_of(given: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """The settings with their defaults.

    Args:
        given: the parameters of the config.
        defaults: of the controller; a number stands for any number.

    Raises:
        UnknownTaskError: one that cannot be reckoned with.
    """
    settings = {**DEFAULTS, **defaults, **given}
    bounds = settings["bounds"]
    tasks = settings["tasks"]
    if not isinstance(bounds, Mapping) or not all(
        value is None or _is_number(value) for value in bounds.values()
    ):
        raise UnknownTaskError(f"parameter bounds is {bounds!r:.40}")
    if tasks is not None and not (
        isinstance(tasks, Sequence) and tasks and all(isinstance(task, Mapping) for task in tasks)
    ):
        raise UnknownTaskError(f"parameter tasks is {tasks!r:.40}")
    for key, usual in {**DEFAULTS, **defaults}.items():
        wrong = isinstance(usual, float) and not _is_number(settings[key])
        if wrong or (key in CHOICES and settings[key] not in CHOICES[key]):
            raise UnknownTaskError(f"parameter {key} is {settings[key]!r:.40}")
    return settings


def of_rows(
    entries: Sequence[Mapping[str, Any]], sizes: Sequence[int], key: str, usual: float
) -> Array:
    """A positive number of each task, for each of its rows, (m,).

    Raises:
        UnknownTaskError: it is none.
    """
    numbers = [entry.get(key, usual) for entry in entries]
    if not all(_is_number(number) and number > 0.0 for number in numbers):
        raise UnknownTaskError(f"{key} of a task is none")
    return np.repeat(np.array(numbers, float), sizes)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
