"""Which cycles a controller went through, from one beginning to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoap3.tools.logs.disk_rows import RowsAt
from hoap3.tools.verify.controller_log import ControllerRun, last_of

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


def cycles_of(run: ControllerRun) -> Cycles:
    """The cycles of the engagements of which the log has all since their begin.

    States to which nothing was ever answered, as those of a robot at rest, are left out.
    """
    states, count = run.states, len(run.states)
    answer = np.full(count, -1, np.int64)
    sound = run.answers.finite("values")
    answer[run.answered[sound]] = np.flatnonzero(sound)
    places = np.arange(count)
    begun, cut = (last_of(marks, places) for marks in (run.resets, run.gaps))
    finite = RowsAt.of(states).finite("q", "reference")
    used = finite & (begun >= 0) & (begun >= cut) & np.isin(begun, begun[run.answered])
    chosen = places[used]
    periods = states["tick"].astype(np.int64) - states["skipped"].astype(np.int64)
    fresh = np.diff(begun[chosen], prepend=-1) != 0
    return Cycles(chosen, answer[chosen], fresh, periods[chosen])
