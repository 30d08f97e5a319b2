"""Weights of tasks that move smoothly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.scheduling.priorities import place
from hoap3.remote_controller.scheduling.schedule import Schedule, Seconds

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


class Weights(Schedule):
    """ω_i of tasks: like `Priorities`, and as continuous.

    Args:
        names: of the tasks.
        settings: as a config has them.

    Attributes:
        value: (k,) at the time of the last `update`; the same memory for ever.

    Raises:
        ConfigError: an unknown task, or two changes of one weight that overlap in time.
    """

    key, request = "weights", WeightRequest

    def __init__(self, names: Sequence[str], settings: WeightSettings) -> None:
        self.names, start = tuple(names), np.ones(len(names))
        self._write(settings.weights, start)
        super().__init__(names, start, settings.timeline)
        self.value = self._transition.value

    def shown(self) -> dict[str, Any]:
        """Names and weights, and whether these are on their way."""
        weights = dict(zip(self.names, self.value.tolist(), strict=True))
        return {"weights": weights, "moving": self.moving}

    def _begin(self) -> None:
        self._goal[:] = self._start

    def _asked(self, request: WeightRequest, time_s: float) -> WeightChange:
        self._write(request.weights, self._goal.copy())
        return WeightChange(at_s=time_s, over_s=request.over_s, weights=request.weights)

    def _shared(self, earlier: WeightChange, later: WeightChange) -> str:
        shared = [name for name in earlier.weights if name in later.weights]
        return f"the weight of {shared[0]}" if shared else ""

    def _set_out(self, change: WeightChange) -> None:
        which = np.array([name in change.weights for name in self.names])
        self._write(change.weights, self._goal)
        self._transition.head(self._goal, which, change.at_s, change.over_s)

    def _write(self, wanted: Mapping[str, float], out: FloatArray) -> None:
        for name, value in wanted.items():
            out[place(name, self.names, f"weights.{name}")] = value
