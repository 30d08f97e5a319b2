"""Attribute each miss to the stage that exceeded its usual length by most.

The usual length is the median over the ticks that were answered in time, so that it is usual even
where most ticks are missed; where none was in time, it is 0, and the longest stage counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from hoap3.tools.analysis.cycles import NEVER, Cycles, Stamps
from hoap3.tools.machine.stalls import Stall

if TYPE_CHECKING:
    from hoap3.tools.analysis.ticks import TickTable

Times = npt.NDArray[np.float64]

IN_CYCLE = ("wait", "decode", "kinematics", "solve", "encode", "send")


def cycle_stages(cycles: Cycles) -> dict[str, Times]:
    """Stages of each cycle by the controller's clock [ns], nan where unknown.

    `computed` is the time from the arrival of the State until the answer is encoded.
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


def attribute_misses(table: TickTable, stages: tuple[str, ...]) -> dict[int, str]:
    """Find the stage of each tick that was missed; `TickTable.attributed_stages` lists them.

    Args:
        table: of one run.
        stages: those that a late answer can be attributed to.
    """
    attribution, rows = _Attribution(table, stages), np.flatnonzero(table.missed).tolist()
    return {int(table.tick[row]): attribution.of(row) for row in rows}


class _Attribution:
    """Excess of each stage over its usual length, and what follows from it for one tick."""

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
        self._stall_time = StallTime(table.stalls or [])

    def of(self, row: int) -> str:
        """Attribute one missed tick."""
        table = self._table
        if table.stalled is not None and table.stalled[row]:
            return self._stage_without_stalls(row) or "host"
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
        delaying = self._delaying_stage(int(self._table.cycle[row]) - 1)
        return delaying[0] if delaying else "wait"

    def _unseen(self, row: int) -> str:
        """Attribute a tick whose State the controller neither answered nor recorded."""
        table = self._table
        before = self._busy_cycle(row)
        if before >= 0:
            delaying = self._delaying_stage(before)
            return delaying[0] if delaying else "no answer"
        overwritten = table.cycles.is_overwritten(table.tick[row : row + 1])[0]
        return "network" if overwritten else "no answer"

    def _busy_cycle(self, row: int) -> int:
        """Return the cycle in which the controller was busy as the State of a tick came, or -1."""
        table, cycles = self._table, self._table.cycles
        before = int(np.searchsorted(cycles.tick, table.tick[row])) - 1
        if before < 0 or table.published[row] == NEVER:
            return -1
        since = table.published[row] - cycles.published[before]
        return before if self._ready[before] > since else -1

    def _delaying_stage(self, cycle: int) -> tuple[str, int] | None:
        """Return the stage that delayed a cycle, and its cycle: this one, or one it waited for."""
        while cycle >= 0 and self._in_cycle[:, cycle].max() > -np.inf:
            worst = IN_CYCLE[int(np.argmax(self._in_cycle[:, cycle]))]
            if worst != "wait":
                return worst, cycle
            cycle -= 1
        return None

    def _stage_without_stalls(self, row: int) -> str | None:
        """Return the controller's stage that alone exceeds a period, without the host's stalls."""
        table = self._table
        own = int(table.cycle[row])
        delaying = self._delaying_stage(own if own >= 0 else self._busy_cycle(row))
        if delaying is None:
            return None
        name, cycle = delaying
        begin = int(table.cycles.published[cycle])
        stalled = self._stall_time.between(begin, begin + int(self._ready[cycle]))
        excess = self._in_cycle[IN_CYCLE.index(name), cycle] - stalled
        return name if excess > table.period else None


class StallTime:
    """Total time of stalls of the host, of any CPU."""

    def __init__(self, stalls: Sequence[Stall]) -> None:
        begins = np.array([stall.start for stall in stalls], np.int64)
        ends = np.array([stall.end for stall in stalls], np.int64)
        reach = np.maximum.accumulate(ends) if len(ends) else ends
        self._begins = np.maximum(begins, np.concatenate([begins[:1], reach[:-1]]))
        self._ends = np.maximum(ends, self._begins)

    def between(self, begin: int, end: int) -> int:
        """Time from `begin` to `end` in which at least one CPU stalled [ns]."""
        overlap = np.minimum(self._ends, end) - np.maximum(self._begins, begin)
        return int(overlap[overlap > 0].sum())
