"""Weights of tasks that move smoothly."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from hoap3.protocol.config.settings import Settings, parse
from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.scheduling.priority_matrix import place
from hoap3.remote_controller.scheduling.settings import Seconds
from hoap3.remote_controller.scheduling.transition import Transition

LIVE = "change of weights"
Weight = Annotated[float, Field(strict=True, ge=0, le=1e6)]


class WeightRequest(Settings):
    """One change of weights."""

    over_s: Seconds = Field(0.0, description="duration of the transition, (15) [s]; 0: at once")
    weights: dict[str, Weight] = Field(min_length=1, description="of some tasks")


class WeightChange(WeightRequest):
    """A change of the timeline."""

    at_s: Seconds = Field(description="its begin, since the controller's [s]")


class WeightSettings(Settings):
    """Weights at the start, and how they change."""

    weights: dict[str, Weight] = Field({}, description="of tasks by their names; others have 1")
    timeline: tuple[WeightChange, ...] = Field(
        (), description="changes, in any order; those of one pair may not overlap"
    )


class Weights:
    """ω_i of tasks: like `Priorities`, and as continuous.

    Args:
        names: of the tasks.
        settings: as they stand in `file` under `key`.

    Attributes:
        value: (k,) at the time of the last `update`; the same memory for ever.
        moving: whether a transition is under way.

    Raises:
        ConfigError: an unknown task, or two changes of one weight that overlap in time.
    """

    def __init__(self, names: Sequence[str], settings: WeightSettings, file: str, key: str) -> None:
        self.names = tuple(names)
        self._start = np.ones(len(names))
        self._write(settings.weights, self._start, file, f"{key}.weights")
        for number, change in enumerate(settings.timeline):
            where = f"{key}.timeline.{number}.weights"
            self._write(change.weights, self._start.copy(), file, where)
        given = sorted(enumerate(settings.timeline), key=lambda item: item[1].at_s)
        for earlier, later in combinations(given, 2):
            _apart(earlier, later, file, key)
        self._timeline = [change for _, change in given]
        self._transition = Transition(self._start)
        self.value, self._goal = self._transition.value, self._start.copy()
        self.reset()

    def reset(self) -> None:
        """Go back to the start and its timeline; live changes are forgotten."""
        self._goal[:] = self._start
        self._transition.rest(self._start)
        self._next, self._changed, self.moving = 0, False, False

    def shown(self) -> dict[str, Any]:
        """Names and weights, and whether these are on their way."""
        weights = dict(zip(self.names, self.value.tolist(), strict=True))
        return {"weights": weights, "moving": self.moving}

    def update(self, time_s: float) -> bool:
        """Recompute the weights for a time since the reset [s]; whether they are others."""
        at = self._timeline[self._next].at_s if self._next < len(self._timeline) else math.inf
        if not self.moving and time_s < at:
            return False
        while self._next < len(self._timeline) and self._timeline[self._next].at_s <= time_s:
            change = self._timeline[self._next]
            self._changed |= self._transition.advance(change.at_s)
            self._head(change.weights, change.at_s, change.over_s)
            self._next += 1
        changed = self._transition.advance(time_s) or self._changed
        self.moving, self._changed = time_s < self._transition.end, False
        return changed

    def change(self, request: Mapping[str, Any], time_s: float) -> None:
        """Begin a change that the timeline does not have; the next `update` shows it.

        Args:
            request: `weights`, a mapping from names, and `over_s` [s].
            time_s: now, since the reset [s].

        Raises:
            ConfigError: something is wrong with it; nothing has been changed then.
        """
        content = dict(request) if isinstance(request, Mapping) else request
        asked = parse(WeightRequest, content, LIVE)
        self._write(asked.weights, self._goal.copy(), LIVE, "weights")
        self._changed |= self.update(time_s)
        self._head(asked.weights, time_s, asked.over_s)

    def _head(self, wanted: Mapping[str, float], at_s: float, over_s: float) -> None:
        which = np.array([name in wanted for name in self.names])
        self._write(wanted, self._goal, LIVE, "weights")
        self._transition.head(self._goal, which, at_s, over_s)
        self.moving = True

    def _write(
        self, wanted: Mapping[str, float], out: np.ndarray[Any, Any], file: str, key: str
    ) -> None:
        for name, value in wanted.items():
            out[place(name, self.names, file, f"{key}.{name}")] = value


def _apart(
    earlier: tuple[int, WeightChange], later: tuple[int, WeightChange], file: str, key: str
) -> None:
    """Refuse two numbered changes of one weight, unless one is over when the other begins."""
    (first, before), (number, after) = earlier, later
    end_s = before.at_s + before.over_s
    shared = [name for name in before.weights if name in after.weights]
    if not shared or (after.at_s > before.at_s and after.at_s >= end_s):
        return
    where, problem = f"{key}.timeline.{number}.at_s", f"overlaps timeline.{first}"
    problem += f", {before.at_s:g} s to {end_s:g} s, in the weight of {shared[0]}"
    remedy = f"Let one end before the other begins: at_s {max(end_s, after.at_s):g}"
    if end_s == after.at_s:
        remedy = "Make one change of both, or give them different times"
    raise ConfigError(file, where, after.at_s, problem, remedy)
