"""The stall monitor: when did the host take a CPU away, and which misses were the host's?

A process of the highest real-time priority sleeps on a 500 us grid on each CPU in use. Nothing in
this system can keep it waiting, so where it wakes late, the CPU itself was away: taken by the
hypervisor, by firmware, or by the kernel where it cannot be interrupted. Such times are noted in
shared memory. Without real-time rights the same lateness could be anybody's load, so there is no
monitor then, and reports give the raw figures only.

Linux hands CPU time to a group that is limited, such as a container or a virtual machine, for
periods of 100 ms; one that has used up its share waits for the next. So these stalls end at the
same point of every 100 ms, and others anywhere.
"""

from __future__ import annotations

import bisect
import ctypes
import gc
import math
import mmap
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from hoap3.protocol.runtime.clock import Clock, MonotonicClock
from hoap3.tools.machine.cpu_idle import kept_awake, let_sleep
from hoap3.tools.machine.processes import Child, Lifeline, read_order

PERIOD_NS = 100_000_000
"""The kernel's default, `cpu.cfs_period_us`."""
LONG_NS = 1_000_000
NEAR_NS = 1_000_000
NEWEST = 100
"""That are compared: two clocks drift apart by some milliseconds in ten minutes."""
SURE = 1e-6
"""Stalls that end anywhere would look like that so often at the most."""


def figures(stalls: Sequence[Stall]) -> dict[str, Any]:
    """How many, how long together, the longest; `long` ones, and those that end `in_step`."""
    lengths = [(stall.end - stall.start) / 1e6 for stall in stalls]
    return {
        "n": len(lengths),
        "total_ms": sum(lengths),
        "longest_ms": max(lengths, default=0.0),
        **ended_in_step(stalls),
    }


def ended_in_step(stalls: Iterable[Stall]) -> dict[str, int]:
    """Of the newest `long` stalls, how many end at the same point of each 100 ms, to 1 ms.

    Long is 1 ms. What several CPUs saw at the same time is one stall. `in_step` is 0 where chance
    may do as much.
    """
    ends = np.sort([stall.end for stall in stalls if stall.end - stall.start >= LONG_NS])
    ends = ends[np.diff(ends, prepend=-PERIOD_NS) > NEAR_NS][-NEWEST:]
    if not ends.size:
        return {"long": 0, "in_step": 0}
    apart = np.abs(ends[:, None] - ends) % PERIOD_NS
    near = np.minimum(apart, PERIOD_NS - apart) < NEAR_NS
    most = int(near.sum(axis=1).max())
    chance = ends.size * _at_least(most - 1, ends.size - 1, 2.0 * NEAR_NS / PERIOD_NS)
    return {"long": int(ends.size), "in_step": most if chance < SURE else 0}


def _at_least(least: int, n: int, p: float) -> float:
    """How likely so many of n are, each of probability p."""
    return sum(math.comb(n, k) * p**k * (1.0 - p) ** (n - k) for k in range(least, n + 1))


def limited(found: Mapping[str, Any]) -> str:
    """What people should know of figures whose stalls end in step; "" where they do not."""
    if not found.get("in_step"):
        return ""
    share = f"{found['in_step']} of the last {found['long']} that took 1 ms or more"
    return (
        f"{share} end at the same point of each 100 ms: the host limits this machine's CPU time "
        "(`hoap3 help operation`)"
    )


PATIENCE_NS = 1_000_000_000  # until a time is judged: the monitor has told of its stalls by then
FOREVER = 1 << 62
MEMORY_NS = 60_000_000_000  # for how long a stall is remembered
LONG_ONES = 4 * NEWEST  # more than those that are compared, as each CPU's count


class OutsideStalls:
    """Counts missed and skipped ticks that overlap a stall of the host, and those that do not.

    Memory stays bounded however long a run is: times are judged soon, and stalls forgotten.

    Args:
        logs: of the monitors, by CPU.

    Attributes:
        outside, hosts: ticks judged so far: ours, and the host's.
        begin, end: stalls between them are counted [ns], all of them by default.
        n, total_ns, longest_ns: of these stalls, each CPU's on its own.
    """

    def __init__(self, logs: dict[int, StallLog]) -> None:
        self._logs = logs
        self._recent: dict[int, list[Stall]] = {cpu: [] for cpu in logs}
        self._failures: deque[tuple[int, int, int]] = deque()  # begin, end [ns], ticks
        self.outside = self.hosts = 0
        self.begin, self.end = 0, FOREVER
        self.n = self.total_ns = self.longest_ns = 0
        self._long: deque[Stall] = deque(maxlen=LONG_ONES)

    @property
    def known(self) -> bool:
        """Whether every CPU is watched, so that a miss without a stall is ours."""
        return bool(self._logs) and all(log.runs for log in self._logs.values())

    def take(self) -> list[tuple[int, Stall]]:
        """Stalls that were noted since the last call, each with its CPU."""
        found = [(cpu, stall) for cpu, log in self._logs.items() for stall in log.take()]
        for cpu, stall in found:
            self._recent[cpu].append(stall)
            if stall.end > self.begin and stall.start < self.end:
                length = stall.end - stall.start
                self.n, self.total_ns = self.n + 1, self.total_ns + length
                self.longest_ns = max(self.longest_ns, length)
                if length >= LONG_NS:
                    self._long.append(stall)
        return found

    def failed(self, start: int, end: int, ticks: int) -> None:
        """Between `start` and `end` [ns] ticks were missed or skipped."""
        self._failures.append((start, end, ticks))

    def attribute(self, now: int) -> None:
        """Attribute what ended long enough before `now` [ns]; a CPU still away is waited for.

        `FOREVER` ends all waiting.
        """
        known = min((log.seen for log in self._logs.values() if log.runs), default=now)
        limit = now if now == FOREVER else min(now - PATIENCE_NS, known - PATIENCE_NS)
        while self._failures and self._failures[0][1] <= limit:
            start, end, ticks = self._failures.popleft()
            if any(overlapping(found, start, end) for found in self._recent.values()):
                self.hosts += ticks
            else:
                self.outside += ticks
        for cpu, found in self._recent.items():
            if found and found[0].end + 2 * MEMORY_NS < now:
                self._recent[cpu] = [stall for stall in found if stall.end + MEMORY_NS >= now]

    def figures(self) -> dict[str, Any]:
        """How many stalls, how long together, the longest; as `ended_in_step`, of the newest."""
        lengths = {"total_ms": self.total_ns / 1e6, "longest_ms": self.longest_ns / 1e6}
        return {"n": self.n, **lengths, **ended_in_step(self._long)}


GRID_NS = 500_000
THRESHOLD_NS = 150_000
CAPACITY = 65_536  # stalls; what is not taken before so many more is overwritten
PRIORITY = 99
NO_RIGHTS = 3  # exit code
START_S = 5.0  # for a monitor to begin
PATIENCE_S = 1.0  # with a monitor that is to end; it looks ten times a second
LOOK_EVERY = 200  # periods between two looks at whether anybody still wants to know
_HEADER = 8  # int64 words: how many, whether it runs, is kept awake, last seen; then unused
_PR_SET_TIMERSLACK = 29

Words = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Stall:
    """A time in which a CPU was away, on the monotonic clock [ns].

    It is what was seen of it: the CPU may have gone up to one grid period before `start`.
    """

    start: int
    end: int


class StallLog:
    """Stalls of one CPU in memory that two processes share.

    Args:
        fd: memory to attach to, or None to create it.
    """

    def __init__(self, fd: int | None = None) -> None:
        size = 8 * (_HEADER + 2 * CAPACITY)
        if fd is None:
            fd = os.memfd_create("hoap3-stalls", os.MFD_CLOEXEC)
            os.ftruncate(fd, size)
        self.fd = fd
        # All of it from the start: no page faults in the monitor, and none of our memory grows.
        memory = mmap.mmap(fd, size, flags=mmap.MAP_SHARED | mmap.MAP_POPULATE)
        self._words: Words = np.frombuffer(memory, np.int64)
        self._taken = 0

    def note(self, start: int, end: int) -> None:
        """Add a stall."""
        count = int(self._words[0])
        at = _HEADER + 2 * (count % CAPACITY)
        self._words[at], self._words[at + 1] = start, end
        self._words[0] = count + 1  # after its content

    def see(self, now: int) -> None:
        """Say that the CPU was there, and that all before is noted."""
        self._words[3] = now

    @property
    def seen(self) -> int:
        """Until when the stalls are known [ns]."""
        return int(self._words[3])

    def begin(self, *, awake: bool = False) -> None:
        """Say that the monitor runs, with the rights that it needs, and keeps its CPU awake."""
        self._words[2] = awake
        self._words[1] = 1

    @property
    def runs(self) -> bool:
        """Whether the monitor got the rights that it needs, and has not ended."""
        return bool(self._words[1])

    def end(self) -> None:
        """Say that the monitor does not run any more."""
        self._words[1] = 0

    @property
    def awake(self) -> bool:
        """Whether the monitor keeps its CPU awake."""
        return bool(self._words[2])

    def take(self) -> list[Stall]:
        """The stalls since the last call, oldest first."""
        count = int(self._words[0])
        new = range(max(self._taken, count - CAPACITY), count)
        self._taken = count
        places = [_HEADER + 2 * (number % CAPACITY) for number in new]
        return [Stall(int(self._words[at]), int(self._words[at + 1])) for at in places]


class StallMonitor:
    """Monitors of some CPUs, one process each; each ends by itself where this process does.

    Args:
        cpus: which.
        keep_awake: whether they never sleep meanwhile. It is up to the monitors since they outlive
            whoever is killed.

    Raises:
        OSError: a process cannot be started.
    """

    def __init__(self, cpus: Iterable[int], *, keep_awake: bool = False) -> None:
        self.logs: dict[int, StallLog] = {}
        self._processes: dict[int, Child] = {}
        self._keep_awake = keep_awake
        self._ended: set[int] = set()
        try:
            for cpu in sorted(set(cpus)):
                log = self.logs[cpu] = StallLog()
                order = {"fd": log.fd, "cpu": cpu, "awake": keep_awake}
                self._processes[cpu] = Child(["hoap3.tools.machine.stalls"], order, [log.fd])
        except BaseException:
            self.stop()
            raise

    def __enter__(self) -> Self:
        """Return once each monitor runs, or has ended."""
        until = time.monotonic() + START_S
        while time.monotonic() < until:
            ended = self._gone()
            if all(log.runs or cpu in ended for cpu, log in self.logs.items()):
                break
            time.sleep(0.01)
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def refused(self) -> list[int]:
        """CPUs whose monitors have ended by themselves: they did not get what they need."""
        return [cpu for cpu in self._gone() if self._processes[cpu].returncode == NO_RIGHTS]

    def killed(self) -> list[int]:
        """CPUs whose monitors have ended otherwise: their stalls are not known any more."""
        return [cpu for cpu in self._gone() if self._processes[cpu].returncode != NO_RIGHTS]

    def stop(self) -> None:
        """End the monitors, and let CPUs sleep that a killed one kept awake."""
        for process in self._processes.values():
            process.cut()
        for cpu, process in self._processes.items():
            process.end(PATIENCE_S if self.logs[cpu].runs else 0.0)  # 0: it has not begun
        if self._keep_awake:
            let_sleep()

    def _gone(self) -> list[int]:
        """CPUs whose monitors have ended; what a killed one left is mended."""
        gone = [cpu for cpu, process in self._processes.items() if process.poll() is not None]
        for cpu in {*gone} - self._ended:
            self._ended.add(cpu)
            self.logs[cpu].end()
            if self._keep_awake:
                let_sleep()
        return gone


def overlapping(stalls: Sequence[Stall], start: int, end: int) -> bool:
    """Whether a time [ns] overlaps one of the stalls, which are sorted by start and disjoint.

    A stall counts from one grid period before its start: that is when the CPU was last seen.
    """
    at = bisect.bisect_right(stalls, start, key=lambda stall: stall.start)
    before = at > 0 and stalls[at - 1].end > start
    return before or (at < len(stalls) and stalls[at].start - GRID_NS < end)


def main() -> int:
    """Watch one CPU until told to end, or until whoever asked is gone; exit 3 without rights."""
    ended = threading.Event()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    parent, order = Lifeline(), read_order()
    log, cpu = StallLog(order["fd"]), order["cpu"]
    if not _rise_above_all(cpu):
        return NO_RIGHTS
    with kept_awake(cpu) if order["awake"] else nullcontext("not asked for") as refusal:
        log.begin(awake=not refusal)
        watch(log, lambda: not (parent.cut() or ended.is_set()), MonotonicClock())
    return 0


def watch(log: StallLog, wanted: Callable[[], bool], clock: Clock) -> None:
    """Sleep on the grid and note each time that was slept through, while it is wanted."""
    now, sleep_until = clock.now, clock.sleep_until
    due = now() + GRID_NS
    while wanted():
        for _ in range(LOOK_EVERY):
            sleep_until(due)
            woke = now()
            if woke - due > THRESHOLD_NS:
                log.note(due, woke)
                due += (woke - due) // GRID_NS * GRID_NS
            due += GRID_NS
            log.see(woke)


def _rise_above_all(cpu: int) -> bool:
    """Be the most urgent process of a CPU; False where that is refused."""
    try:
        os.sched_setaffinity(0, {cpu})
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return False
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(1), 0, 0, 0)
    gc.collect()
    gc.freeze()
    gc.disable()
    return True


if __name__ == "__main__":
    sys.exit(main())
