"""Watches a run from beside it: its processes, its metrics, and the schedule of its ticks."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import State
from hoap3.tools.soak.process_tree import Holdings, descendants, holdings, name_of
from hoap3.tools.soak.rounds import Rounds
from hoap3.tools.soak.scrape import FAILURES, scrape

ROUND_S = 5.0
LEAST_ROUND_S = 0.25
LEAST_ROUNDS = 60  # of the measured time, where that is short
END_S = 0.5  # before the end no round begins: the services may be on their way out
NOTES = 10  # while it goes on

HELD = tuple(Holdings.__dataclass_fields__)
ROBOT = (
    *("deadlines_met_total", "deadlines_missed_total", "deadlines_late_total"),
    *("ticks_skipped_total", "misses_outside_stalls_total"),
    *("host_stalls_total", "host_stall_seconds_total"),
    *("wakeup_seconds_sum", "wakeup_seconds_count"),
)
BOTH = ("log_bytes", "log_lost", "dropped_records_total")


@dataclass(frozen=True)
class Plan:
    """How long a soak takes.

    Attributes:
        duration_s: of the motion [s].
        warm_up_s: from its begin, which is not measured [s].

    Raises:
        UsageError: nothing is left to be measured.
    """

    duration_s: float
    warm_up_s: float

    def __post_init__(self) -> None:
        if self.warm_up_s + LEAST_ROUND_S * 4 + END_S > self.duration_s:
            raise UsageError(
                f"--warm-up-minutes: {self.warm_up_s / 60:g} min of warm-up leave nothing of "
                f"{self.duration_s / 60:g} min to be measured. Make the soak longer, or the "
                "warm-up shorter"
            )

    @property
    def round_s(self) -> float:
        """Time from a round to the next [s]."""
        fit = (self.duration_s - self.warm_up_s) / LEAST_ROUNDS
        return min(max(fit, LEAST_ROUND_S), ROUND_S)


class Watch:
    """What is seen of a run.

    Args:
        plan: how long it takes.
        doors: host and port of the metrics of each side.
        period_ns: of the robot.
        say: takes how far it is, now and then, for people.

    Attributes:
        processes: rounds of each process that was ever there, by its number.
        sides: rounds of the metrics of each side.
        scrapes, unanswered: how often metrics were asked for, and how often in vain.
        heard: States whose stamps were looked at.
        drift_ns: how far the schedule left start + k·T, at most; 0 is expected.
        sessions: of the robot; one is expected.
    """

    def __init__(
        self,
        plan: Plan,
        doors: Mapping[str, tuple[str, int]],
        period_ns: int,
        say: Callable[[str], None],
    ) -> None:
        self._plan, self._doors, self._period_ns, self._say = plan, doors, period_ns, say
        self.processes: dict[int, Rounds] = {}
        self.sides = {side: Rounds((*ROBOT, *BOTH) if side == "robot" else BOTH) for side in doors}
        self.scrapes = self.unanswered = self.heard = self.drift_ns = 0
        self.sessions: set[int] = set()
        self._start_ns: int | None = None  # of the motion
        self._phase = (0, 0)  # least and largest
        self._due_s = self._note_s = 0.0

    @property
    def began(self) -> bool:
        """Whether the robot has moved."""
        return self._start_ns is not None

    def hear(self, item: Mapping[str, Any]) -> None:
        """Take a piece of news; those of the robot's newest State tell its schedule."""
        if item["news"] != "live" or "tick" not in item:
            return
        intended = item["stamp_intended"]
        if self._start_ns is None:
            if item["mode"] == State.IDLE:  # one that stopped at once was active in between
                return
            self._start_ns = intended
        if item["session_id"] not in self.sessions:  # another robot has a schedule of its own
            self.sessions.add(item["session_id"])
            self._phase = (intended - item["tick"] * self._period_ns,) * 2
        phase = intended - item["tick"] * self._period_ns
        self._phase = min(phase, self._phase[0]), max(phase, self._phase[1])
        self.drift_ns = max(self.drift_ns, self._phase[1] - self._phase[0])
        self.heard += 1

    def look(self) -> None:
        """Do what is due; called some ten times a second."""
        if self._start_ns is None:
            return
        now = (time.monotonic_ns() - self._start_ns) / 1e9
        if now < self._due_s or now > self._plan.duration_s - END_S:
            return
        self._due_s = now + self._plan.round_s
        self._count(now)  # before a scrape, for which the service has a thread and a socket
        for side, (host, port) in self._doors.items():
            self._ask(now, side, host, port)
        if now >= self._note_s:
            self._tell(now)

    def _count(self, now: float) -> None:
        """What every process of ours holds."""
        names = {os.getpid(): "soak"}
        for pid, parent in descendants(os.getpid()).items():
            held = holdings(pid)
            if held is None:
                continue
            if pid not in self.processes:
                self.processes[pid] = Rounds(HELD, name_of(pid, names.get(parent, "?")))
            names[pid] = self.processes[pid].label
            self.processes[pid].add(now, vars(held))

    def _ask(self, now: float, side: str, host: str, port: int) -> None:
        self.scrapes += 1
        figures: dict[str, float] = {}
        try:
            figures = scrape(host, port)
        except FAILURES:
            self.unanswered += 1
        self.sides[side].add(now, figures)

    def _tell(self, now: float) -> None:
        """How far it is; the first note after the warm-up says that."""
        warm, whole = self._plan.warm_up_s, self._plan.duration_s
        if now < warm:
            self._note_s = warm
            return
        done = int(NOTES * now / whole) + 1
        self._note_s = whole * done / NOTES
        held = sum(rounds.since(now)["rss_bytes"].sum() for rounds in self.processes.values())
        self._say(
            f"{now / 60:.3g} of {whole / 60:.3g} min, measured since {warm / 60:.3g} min; "
            f"{held / 1e6:.1f} MB in all"
        )
