"""How far a task may be from its trajectory, on the way and at its end."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hoap3.protocol.errors import ConfigError, one_of
from hoap3.protocol.messages import FloatArray

INSTANT_S = 1e-9  # times are compared to it: what ticks × period round
Where = Literal["path", "goal"]


@dataclass(frozen=True)
class Violation:
    """One tolerance that was not kept.

    Attributes:
        where: on the path, or at the goal.
        name: of the joint or axis.
        error: of it, ≥ 0, in `unit`; inf for one that is not finite.
        tolerance: in the same unit.
        unit: rad or m.
        tick: of the State.
        held: whether the task stays where the robot was then.
    """

    where: Where
    name: str
    error: float
    tolerance: float
    unit: str
    tick: int
    held: bool

    def __str__(self) -> str:
        what = "off its path" if self.where == "path" else "off its goal"
        then = "it stays there" if self.held else "it goes on"
        return (
            f"{self.name} was {self.error:.6g} {self.unit} {what} at tick {self.tick}, "
            f"tolerance {self.tolerance:.6g} {self.unit}; {then}"
        )


class Tolerances:
    """Compares errors with tolerances, once for each State.

    Path: from the start to the end of the trajectory, at every State, |e_i| ≤ path_i. Goal: at some
    State from the end until `goal_time_s` later, all |e_i| ≤ goal_i at once; the last that counts
    is the first State at or after that time. The first violation is the only one: afterwards
    nothing is compared.

    Args:
        names, units: of the components of e, (m,).
        path, goal: tolerances, (m,) [rad or m]; inf: none.
        goal_time_s: see above [s].
        holds: whether the task stays where the robot is at a violation.
        end_s: when the trajectory ends, since its start [s].

    Attributes:
        violation: what was violated, or None.
        reached: whether the goal was reached in time.
    """

    def __init__(
        self,
        names: Sequence[str],
        units: Sequence[str],
        path: FloatArray,
        goal: FloatArray,
        goal_time_s: float,
        end_s: float,
        *,
        holds: bool,
    ) -> None:
        self._names, self._units, self._path, self._goal = names, units, path, goal
        self._end, self._late, self.holds = end_s, end_s + goal_time_s, holds
        self._asks_goal = bool(np.isfinite(goal).any())
        self._sizes = np.zeros(len(names))
        self.restart()

    def restart(self) -> None:
        """Begin anew."""
        self.violation: Violation | None = None
        self.reached = False

    def judge(self, error: FloatArray, elapsed_s: float, tick: int) -> bool:
        """Compare; whether this is the State of the violation.

        Args:
            error: e, (m,), of the robot as it was measured, without weights [rad or m].
            elapsed_s: since the start [s].
            tick: of the State.
        """
        if self.violation is not None or self.reached:
            return False
        sizes = np.abs(error, out=self._sizes)
        if elapsed_s < self._end - INSTANT_S:
            return self._violated("path", sizes, self._path, tick)
        if not self._asks_goal:
            return False
        self.reached = bool((sizes <= self._goal).all())
        if self.reached or elapsed_s < self._late - INSTANT_S:
            return False
        return self._violated("goal", sizes, self._goal, tick)

    def _violated(self, where: Where, sizes: FloatArray, tolerances: FloatArray, tick: int) -> bool:
        kept = sizes <= tolerances
        if kept.all():
            return False
        shares = [
            0.0 if ok else self._share(*of) for ok, *of in zip(kept, sizes, tolerances, strict=True)
        ]
        i = shares.index(max(shares))
        size = float(sizes[i]) if math.isfinite(sizes[i]) else math.inf
        told = self._names[i], size, float(tolerances[i]), self._units[i]
        self.violation = Violation(where, *told, tick, self.holds)
        return True

    @staticmethod
    def _share(size: float, tolerance: float) -> float:
        return float(size / tolerance) if math.isfinite(size) else math.inf


def each_of(
    given: float | Mapping[str, float] | None, names: Sequence[str], key: str
) -> FloatArray:
    """A tolerance for each name, (m,); inf where there is none.

    Raises:
        ConfigError: one for a name that is not there.
    """
    if not isinstance(given, Mapping):
        return np.full(len(names), math.inf if given is None else given)
    for name in given:
        if name not in names:
            remedy = one_of(name, names, "There are")
            raise ConfigError("", f"{key}.{name}", None, "is no component of this task", remedy)
    return np.array([given.get(name, math.inf) for name in names])
