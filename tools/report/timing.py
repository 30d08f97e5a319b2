"""Deadlines and durations of a run, from the table of its ticks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from protocol.messages import Event, FloatArray
from protocol.ring import Kind
from protocol.statistics import WINDOW, verdict
from tools.report.numbers import summary
from tools.report.sources import Sources
from tools.stalls import figures as stall_figures
from tools.tick_logs import Cycles, RobotSide
from tools.ticks import IN_TIME, LATE, LOST, SKIPPED, STAGES, TickTable

_FORCED = ("REASON_MISSES", "REASON_HOLDER_LOST")


@dataclass(frozen=True)
class Timing:
    """What became of the ticks.

    Attributes:
        table: one row a tick.
        safe_stops: those that misses or a lost holder forced.
    """

    table: TickTable
    safe_stops: int

    @property
    def asked(self) -> int:
        """Ticks that asked for an answer."""
        return int(np.count_nonzero(self.table.asked))

    @property
    def verdict(self) -> str:
        """`fit`, `warn` or `unfit`."""
        rate = self.table.success_rate
        return "unfit" if rate is None else verdict(rate, safe_stop=self.safe_stops > 0)

    @property
    def start_ns(self) -> int:
        """Intended start of the first tick that asked."""
        return int(self.table.intended[0])

    @property
    def seconds(self) -> FloatArray:
        """Intended start of each tick, from the first one on [s]."""
        return np.asarray((self.table.intended - self.start_ns) / 1e9, float)

    @property
    def duration_s(self) -> float:
        """From there to the end of the last one."""
        return float(self.seconds[-1]) + self.table.period / 1e9

    def us(self, name: str) -> FloatArray:
        """A stage, or `rtt`, of every tick [µs]; NaN where there is none."""
        return np.asarray(self.table.stage(name) / 1e3, float)

    def jitter_us(self) -> FloatArray:
        """|time between two wake-ups − T| [µs] where no tick was skipped or lost between them."""
        asked = np.flatnonzero(self.table.asked)
        next_ = np.diff(self.table.tick[asked]) == 1
        deviation = np.diff(self.table.actual[asked])[next_] - self.table.period
        return np.asarray(deviation / 1e3, float)

    def recent(self) -> FloatArray:
        """Success rate of the last 100 ticks, at each tick that asked."""
        return _recent(_hits(self.table))

    def as_json(self) -> dict[str, Any]:
        """The figures, under the names that `run --json` gives them; durations unless virtual."""
        table = self.table
        result: dict[str, Any] = {
            "verdict": self.verdict,
            "ticks": self.asked,
            "skipped": table.count(SKIPPED),
            "misses": {
                "late": table.count(LATE),
                "lost": table.count(LOST),
                "longest_run": _longest_run(table),
            },
            "misses_outside_stalls": table.misses_outside_stalls,
            "host_stalls": None if table.stalls is None else stall_figures(table.stalls),
            "success_rate": {
                "run": table.success_rate,
                "outside_stalls": table.success_rate_outside_stalls,
                "worst_window": _worst_window(table),
            },
            "safe_stops": self.safe_stops,
            "guilty": table.guilty_counts(),
        }
        if not table.lockstep:
            jitter = self.jitter_us()
            sizes = summary(np.abs(jitter))
            result["rtt_us"] = summary(self.us("rtt"))
            result["wakeup_us"] = summary(self.us("wakeup"))
            result["jitter_us"] = sizes
            if len(jitter) > 1:
                sizes["std"] = float(jitter.std(ddof=1))
                sizes["p99_9_minus_p50"] = sizes["p99_9"] - sizes["p50"]
            names = (*STAGES, "unaccounted")
            result["stages_us"] = {name: summary(self.us(name)) for name in names}
        return result


def read_timing(sources: Sources) -> Timing | None:
    """What became of the ticks of a run; None without the robot's log, or where nothing asked.

    Raises:
        LogError: it was recorded from outside, or holds no State.
    """
    if sources.robot is None:
        return None
    robot = RobotSide.read(sources.path)
    table = TickTable.of(robot, Cycles.of(sources.controller, robot))
    if not table.asked.any():
        return None
    _, events = sources.robot.table(Kind.EVENT)
    constants = Event.schema.constants
    stops = events[events["kind"] == constants["SAFE_STOP"]]
    forced = np.isin(stops["detail"], [constants[name] for name in _FORCED])
    return Timing(table, int(forced.sum()))


def _hits(table: TickTable) -> Any:
    return table.outcome[table.asked] == IN_TIME


def _recent(hits: Any) -> FloatArray:
    """(n,) share of hits among the last 100, or among all so far."""
    total = np.concatenate([[0], np.cumsum(hits)])
    end = np.arange(1, len(total))
    begin = np.maximum(end - WINDOW, 0)
    return np.asarray((total[end] - total[begin]) / (end - begin), float)


def _longest_run(table: TickTable) -> int:
    """Most misses in a row; skipped ticks neither add to it nor end it."""
    ends = np.flatnonzero(np.concatenate([[True], _hits(table), [True]]))
    return int(np.diff(ends).max()) - 1


def _worst_window(table: TickTable) -> float | None:
    """Least success rate of any 100 ticks in a row that asked; None where there were fewer."""
    full = _recent(_hits(table))[WINDOW - 1 :]
    return float(full.min()) if len(full) else None
