"""Which misses were the host's: the count of those that no stall excuses, while a run goes on."""

from __future__ import annotations

from collections import deque
from typing import Any

from hoap3.tools.machine.stall_figures import LONG_NS, NEWEST, ended_in_step
from hoap3.tools.machine.stalls import Stall, StallLog, overlapping

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
