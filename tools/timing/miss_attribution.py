"""Who is to blame for each miss: the stage that exceeded its usual length by most.

The usual length is the median over the ticks that were answered in time, so that it is usual even
where most ticks are missed; where none was in time, it is nothing, and the longest stage is to
blame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from hoap3.tools.machine.stalls import Stall
from hoap3.tools.timing.tick_logs import NEVER, Cycles, Stamps

if TYPE_CHECKING:
    from hoap3.tools.timing.ticks import TickTable

Times = npt.NDArray[np.float64]

IN_CYCLE = ("wait", "decode", "kinematics", "solve", "encode", "send")


def cycle_stages(cycles: Cycles) -> dict[str, Times]:
    """Stages of each cycle by the controller's clock [ns], nan where unknown.

    `computed` is the whole from the State's arrival to the handing over of the answer.
    """
    return {
        "wait": cycles.waits(),
        "decode": between(cycles.received, cycles.decoded),
        "kinematics": between(cycles.decoded, cycles.kinematics),
        "solve": between(cycles.kinematics, cycles.solved),
        "encode": between(cycles.solved, cycles.encoded),
        "send": between(cycles.encoded, cycles.sent),
        "computed": between(cycles.received, cycles.encoded),
    }


def between(start: Stamps, end: Stamps) -> Times:
    """Time from one stamp to another of the same clock [ns], nan where either is missing."""
    known = (start != NEVER) & (end != NEVER)
    return np.where(known, (end - start).astype(float), np.nan)


class Blame:
    """Finds who is to blame in a table of ticks.

    Args:
        table: of one run.
        stages: those that can be to blame for a late answer.
    """

    def __init__(self, table: TickTable, stages: tuple[str, ...]) -> None:
        self._table, self._stages = table, stages
        in_time = ~table.missed
        lengths = np.stack([table.stage(name) for name in stages])
        usual = np.zeros(len(stages))
        for place, values in enumerate(lengths):
            known = values[in_time & ~np.isnan(values)]
            usual[place] = np.median(known) if len(known) else 0.0
        self._excess = lengths - usual[:, None]
        self._excess[np.isnan(lengths) | (lengths == 0)] = -np.inf
        usual_of = dict(zip(stages, usual, strict=True))
        within = cycle_stages(table.cycles)
        self._in_cycle = np.stack([within[name] - usual_of[name] for name in IN_CYCLE])
        self._in_cycle[np.isnan(self._in_cycle)] = -np.inf
        self._ready = table.cycles.ready()
        self._away = Away(table.stalls or [])

    def guilty(self) -> dict[int, str]:
        """The guilty one for each tick that was missed; `TickTable.guilty` has the words."""
        table = self._table
        rows = np.flatnonzero(table.missed).tolist()
        return {int(table.tick[row]): self._of(row) for row in rows}

    def _of(self, row: int) -> str:
        table = self._table
        if table.stalled is not None and table.stalled[row]:
            return self._in_spite_of_stalls(row) or "host"
        if not table.asked[row]:
            return "wakeup"
        if not np.isnan(table.stage("rtt")[row]):
            return self._late(row)
        if table.refused[row]:
            return "rejected"
        own = int(table.cycle[row])
        if own >= 0:
            return "network" if table.cycles.answered[own] else "silent"
        return self._unseen(row)

    def _late(self, row: int) -> str:
        worst = self._stages[int(np.argmax(self._excess[:, row]))]
        if worst != "wait":
            return worst
        culprit = self._culprit(int(self._table.cycle[row]) - 1)
        return culprit[0] if culprit else "wait"

    def _unseen(self, row: int) -> str:
        """Of a tick whose State the controller never answered, nor said that it had it."""
        table = self._table
        before = self._busy_with(row)
        if before >= 0:
            culprit = self._culprit(before)
            return culprit[0] if culprit else "no answer"
        overwritten = table.cycles.says_overwritten(table.tick[row : row + 1])[0]
        return "network" if overwritten else "no answer"

    def _busy_with(self, row: int) -> int:
        """The cycle that kept the controller from a tick without one, or -1."""
        table, cycles = self._table, self._table.cycles
        before = int(np.searchsorted(cycles.tick, table.tick[row])) - 1
        if before < 0 or table.published[row] == NEVER:
            return -1
        since = table.published[row] - cycles.published[before]
        return before if self._ready[before] > since else -1

    def _culprit(self, cycle: int) -> tuple[str, int] | None:
        """The stage that held a cycle up, and its cycle: this one, or one for which it waited."""
        while cycle >= 0 and self._in_cycle[:, cycle].max() > -np.inf:
            worst = IN_CYCLE[int(np.argmax(self._in_cycle[:, cycle]))]
            if worst != "wait":
                return worst, cycle
            cycle -= 1
        return None

    def _in_spite_of_stalls(self, row: int) -> str | None:
        """The controller's stage that by itself cost the tick, whatever else the host took."""
        table = self._table
        own = int(table.cycle[row])
        culprit = self._culprit(own if own >= 0 else self._busy_with(row))
        if culprit is None:
            return None
        name, cycle = culprit
        begin = int(table.cycles.published[cycle])
        stalled = self._away.between(begin, begin + int(self._ready[cycle]))
        excess = self._in_cycle[IN_CYCLE.index(name), cycle] - stalled
        return name if excess > table.period else None


class Away:
    """For how long some CPU was away, by the stalls that were seen."""

    def __init__(self, stalls: Sequence[Stall]) -> None:
        begins = np.array([stall.start for stall in stalls], np.int64)
        ends = np.array([stall.end for stall in stalls], np.int64)
        reach = np.maximum.accumulate(ends) if len(ends) else ends
        self._begins = np.maximum(begins, np.concatenate([begins[:1], reach[:-1]]))
        self._ends = np.maximum(ends, self._begins)

    def between(self, begin: int, end: int) -> int:
        """Time within a period in which at least one CPU was away [ns]."""
        overlap = np.minimum(self._ends, end) - np.maximum(self._begins, begin)
        return int(overlap[overlap > 0].sum())
