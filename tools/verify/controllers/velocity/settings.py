"""Settings of the controllers of several tasks: those of the log's config, else the defaults."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.oracles.parameters import (
    UnverifiableError,
    complete,
    is_number,
)

Array = NDArray[np.float64]

DEFAULTS: dict[str, Any] = {
    "tasks": None,
    "bounds": {},
    "leave_singularity": (False, True),
    "kinematics_from": ("measured", "reference"),
    "integrate_from": ("reference", "measured"),
}


def settings_of(given: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """The settings with their defaults.

    Args:
        given: the parameters of the config.
        defaults: of the controller, in addition to those here.

    Raises:
        UnverifiableError: a value that cannot be used.
    """
    settings = complete(given, {**DEFAULTS, **defaults}, "parameters", strict=False)
    bounds, tasks = settings["bounds"], settings["tasks"]
    if not all(value is None or is_number(value) for value in bounds.values()):
        raise UnverifiableError(f"parameter bounds is {bounds!r:.40}")
    if tasks is not None and not (
        isinstance(tasks, Sequence) and tasks and all(isinstance(task, Mapping) for task in tasks)
    ):
        raise UnverifiableError(f"parameter tasks is {tasks!r:.40}")
    return settings


def of_rows(
    entries: Sequence[Mapping[str, Any]], sizes: Sequence[int], key: str, usual: float
) -> Array:
    """A positive number of each task, for each of its rows, (m,).

    Raises:
        UnverifiableError: it is none.
    """
    numbers = [entry.get(key, usual) for entry in entries]
    if not all(is_number(number) and number > 0.0 for number in numbers):
        raise UnverifiableError(f"{key} of a task is none")
    return np.repeat(np.array(numbers, float), sizes)
