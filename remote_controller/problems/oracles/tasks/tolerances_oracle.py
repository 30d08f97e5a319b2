"""Whether a task has left its trajectory, and stays where it was then."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.oracles.tasks.target_oracle import Target

Array = NDArray[np.float64]
INSTANT_S = 1e-9  # times are compared to it


class Tolerances:
    """On the way each component is within `path` at each State; at the end, in time, in `goal`.

    Attributes:
        holds: whether the task stays where it is at a violation.
        open: whether anything is still to be compared.
    """

    def __init__(self, path: Array, goal: Array, end_s: float, late_s: float, holds: bool) -> None:
        self._path, self._goal, self._end, self._late = path, goal, end_s, late_s
        self.holds, self.open = holds, True

    def broken(self, error: Array, elapsed_s: float) -> bool:
        """Whether a tolerance is violated now; nothing is compared afterwards."""
        if elapsed_s < self._end - INSTANT_S:
            kept = bool(np.all(np.abs(error) <= self._path))
            self.open = kept
            return not kept
        reached = bool(np.all(np.abs(error) <= self._goal))
        late = elapsed_s >= self._late - INSTANT_S
        self.open = not (reached or late)
        return late and not reached


def tolerances_of(
    given: Mapping[str, Any], names: Sequence[str], target: Target
) -> Tolerances | None:
    """Those of a trajectory's settings; None where there are none.

    Args:
        given: the settings.
        names: of the components of the task's error.
        target: what was made of them; it knows when it ends.
    """

    def each(key: str) -> Array:
        found = given.get(key)
        if isinstance(found, Mapping):
            return np.array([float(found.get(name, np.inf)) for name in names])
        return np.full(len(names), np.inf if found is None else float(found))

    if given.get("path_tolerance") is None and given.get("goal_tolerance") is None:
        return None
    end = target.end_s
    late = end + float(given.get("goal_time_s", 0.0))
    holds = given.get("if_violated", "hold") == "hold"
    return Tolerances(each("path_tolerance"), each("goal_tolerance"), end, late, holds)
