"""Watches a run from another process: its processes, its metrics, and the schedule of its ticks."""

from __future__ import annotations

import math
import os
import time
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import State

Series = npt.NDArray[np.float64]

ROUND_S = 5.0
LEAST_ROUND_S = 0.25
LEAST_ROUNDS = 60  # of the measured time, where that is short
END_S = 0.5  # before the end no round begins: the services may be on their way out
NOTES = 10  # while it goes on

HELD = ("rss_bytes", "descriptors", "threads")
ROBOT = (
    *("deadlines_met_total", "deadlines_missed_total", "deadlines_late_total"),
    *("ticks_skipped_total", "misses_outside_stalls_total"),
    *("host_stalls_total", "host_stall_seconds_total"),
    *("wakeup_seconds_sum", "wakeup_seconds_count"),
)
BOTH = ("log_bytes", "log_lost", "dropped_records_total")

PROC = Path("/proc")
SERVICE, OBSERVER = "hoap3.tools.services.services", "hoap3.tools.services.observer"
STALLS = "hoap3.tools.machine.stalls"
SERVICES = {"emulator": "robot", "controller": "controller"}

PATIENCE_S = 2.0
LABELS = {"side", "robot"}
FAILURES: Final = (OSError, HTTPException, ValueError)
"""What a scrape may raise."""


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


class Rounds:
    """Figures by name, one value a round.

    Args:
        names: of the figures.
        label: whose they are, for people.
    """

    def __init__(self, names: Sequence[str], label: str = "") -> None:
        self.label = label
        self._times = array("d")
        self._columns = {name: array("d") for name in names}

    def add(self, time_s: float, figures: Mapping[str, float]) -> None:
        """A round; what `figures` does not have is no number in it."""
        self._times.append(time_s)
        for name, column in self._columns.items():
            column.append(figures.get(name, math.nan))

    def since(self, begin_s: float) -> dict[str, Series]:
        """Every figure from a time on, and `t`, the times of its rounds [s]."""
        times = np.array(self._times)
        there = times >= begin_s
        columns = {name: np.array(column)[there] for name, column in self._columns.items()}
        return {"t": times[there], **columns}


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

    def receive(self, item: Mapping[str, Any]) -> None:
        """Take live figures; those of the robot's newest State tell its schedule."""
        if "tick" not in item:
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
            self.processes[pid].add(now, held)

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


def descendants(pid: int) -> dict[int, int]:
    """Every process below this one, and its parent; parents come first."""
    children: dict[int, list[int]] = {}
    for entry in os.listdir(PROC):
        if entry.isdecimal():
            parent = _parent(entry)
            if parent is not None:
                children.setdefault(parent, []).append(int(entry))
    found: dict[int, int] = {}
    above = [pid]
    for parent in above:
        for child in sorted(children.get(parent, [])):
            found[child] = parent
            above.append(child)
    return found


def holdings(pid: int) -> dict[str, int] | None:
    """Resident memory, open files and threads of a process, by `HELD`; None where it has ended.

    Memory is from `status`, shared pages included: `smaps_rollup` would hold a lock of the process
    while its pages are walked.
    """
    try:
        facts = _status(pid)
        kilobytes, threads = facts["VmRSS"].split()[0], facts["Threads"]
        descriptors = len(os.listdir(PROC / str(pid) / "fd"))
    except (OSError, KeyError):  # what has ended has no memory
        return None
    figures = (1024 * int(kilobytes), descriptors, int(threads))
    return dict(zip(HELD, figures, strict=True))


def name_of(pid: int, parent: str) -> str:
    """What people call a process, by its command line and the name of its parent."""
    try:
        words = (PROC / str(pid) / "cmdline").read_bytes().decode(errors="replace").split("\0")
        cpu = _status(pid).get("Cpus_allowed_list", "?")
    except OSError:
        return f"process {pid}"
    module, *rest = words[words.index("-m") + 1 :] if "-m" in words else words
    if module == SERVICE and rest and rest[0] in SERVICES:
        return SERVICES[rest[0]]
    if module == OBSERVER:
        return f"observer of the {parent}"
    return f"stall monitor of CPU {cpu}" if module == STALLS else Path(module).name


def _parent(pid: str) -> int | None:
    try:
        stat = (PROC / pid / "stat").read_bytes()
    except OSError:
        return None  # it has ended
    return int(stat.rpartition(b")")[2].split()[1])  # its name may have any sign in it


def _status(pid: int) -> dict[str, str]:
    text = (PROC / str(pid) / "status").read_text(encoding="utf-8", errors="replace")
    pairs = (line.partition(":") for line in text.splitlines())
    return {key: value.strip() for key, _, value in pairs}


def scrape(host: str, port: int) -> dict[str, float]:
    """Every figure that has no labels but side and robot, by its name without `hoap3_`.

    Raises:
        OSError, HTTPException, ValueError: nothing answers, or not as it should.
    """
    from prometheus_client.parser import text_string_to_metric_families

    connection = HTTPConnection(host, port, timeout=PATIENCE_S)
    try:
        connection.request("GET", "/metrics")
        answer = connection.getresponse()
        if answer.status != 200:
            raise HTTPException(f"status {answer.status}")
        text = answer.read().decode()
    finally:
        connection.close()
    return {
        sample.name.removeprefix("hoap3_"): float(sample.value)
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if sample.labels.keys() == LABELS
    }
