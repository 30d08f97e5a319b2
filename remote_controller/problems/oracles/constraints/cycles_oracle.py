"""Which cycles a controller went through, from one beginning to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Places = NDArray[np.int64]


@dataclass(frozen=True)
class Cycles:
    """Finite States that a controller processed since it last began, with their answers.

    Attributes:
        places: of the States in `run.states`, (N,).
        answers: of the answer to each in `run.answers`, (N,); −1 where there is none, or one that
            is not finite.
        fresh: whether a State is the first since the controller began anew, (N,).
        periods: of the robot since its start, without those that it skipped, (N,).
    """

    places: Places
    answers: Places
    fresh: NDArray[np.bool_]
    periods: Places

    @property
    def first(self) -> Places:
        """For each cycle the number of the one in which the controller began, (N,)."""
        starts = np.flatnonzero(self.fresh)
        return np.asarray(starts[np.cumsum(self.fresh) - 1])

    def shares(self, ramp_s: float, period_s: float) -> NDArray[np.float64]:
        """Share of Ψ at each cycle, (N,): it grows linearly from the beginning on."""
        begun, ticks = self.periods[self.first], ramp_s / period_s
        done = self.periods - begun + 1.0
        return np.asarray(np.where(done >= ticks, 1.0, done / max(ticks, 1.0)))
