"""What became of the ticks of a run, over time; the figures are those of `hoap3 latency`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.deadlines import WINDOW
from hoap3.tools.machine.stalls import Stall
from hoap3.tools.report.sources import Sources
from hoap3.tools.timing.tick_logs import Cycles, RobotSide
from hoap3.tools.timing.tick_metrics import tick_figures
from hoap3.tools.timing.ticks import IN_TIME, TickTable


@dataclass(frozen=True)
class Timing:
    """The ticks of a run.

    Attributes:
        table: one row a tick, of which at least one asked for an answer.
        realtime: real-time measures of the robot's process; None where they are not known.
    """

    table: TickTable
    realtime: list[str] | None = None

    @cached_property
    def figures(self) -> dict[str, Any]:
        """Under the names that `run --json` gives them; durations unless all time is virtual."""
        return tick_figures([self.table], realtime=self.realtime)

    @property
    def asked(self) -> int:
        """Ticks that asked for an answer."""
        return int(np.count_nonzero(self.table.asked))

    @property
    def verdict(self) -> dict[str, Any]:
        """On the deadlines, as `judge_deadlines` returns it."""
        verdict: str = self.figures["verdicts"]["deadlines"]
        return {"verdict": verdict, **self.figures["deadlines"]}

    @property
    def start_ns(self) -> int:
        """Intended start of the first tick."""
        return int(self.table.intended[0])

    @property
    def seconds(self) -> FloatArray:
        """Intended start of each tick, from the first one on [s]."""
        return np.asarray((self.table.intended - self.start_ns) / 1e9, float)

    @property
    def duration_s(self) -> float:
        """From there to the end of the last one."""
        return float(self.seconds[-1]) + self.table.period / 1e9

    @property
    def stalls(self) -> list[Stall]:
        """Of the host, from the first tick to the end of the last; none where nobody watched."""
        return self.table.stalls_of_motion or []

    def us(self, name: str) -> FloatArray:
        """A stage, or `rtt`, of every tick [µs]; NaN where there is none."""
        return np.asarray(self.table.stage(name) / 1e3, float)

    def recent(self) -> FloatArray:
        """Success rate of the last 100 ticks, or of all so far, at each tick that asked."""
        hits = self.table.outcome[self.table.asked] == IN_TIME
        total = np.concatenate([[0], np.cumsum(hits)])
        end = np.arange(1, len(total))
        begin = np.maximum(end - WINDOW, 0)
        return np.asarray((total[end] - total[begin]) / (end - begin), float)


def read_timing(sources: Sources) -> Timing | None:
    """What became of the ticks of a run; None without the robot's log, or where nothing asked.

    Raises:
        LogError: it was recorded from outside, or holds no State.
    """
    if sources.robot is None:
        return None
    robot = RobotSide.read(sources.path)
    table = TickTable.of(robot, Cycles.of(sources.controller, robot))
    return Timing(table, sources.realtime) if table.asked.any() else None
