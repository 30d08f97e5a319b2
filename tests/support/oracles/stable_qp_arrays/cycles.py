"""Which cycles a controller went through, from one beginning to the next."""

from __future__ import annotations

import numpy as np

from hoap3.remote_controller.problems.oracles.constraints.cycles_oracle import Cycles
from hoap3.tools.logs.disk_rows import RowsAt
from hoap3.tools.verify.controller_log import ControllerRun, last_of


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
