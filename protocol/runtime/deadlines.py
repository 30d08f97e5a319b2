"""Figures that users see, as docs/start/concepts.md defines them.

Deadlines are counted by the robot itself, tick by tick; durations go into histograms with fixed
memory, so a service can run for months.
"""

from __future__ import annotations

import heapq
from array import array
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

WINDOW = 100

PERCENTILES = {"p50": 50.0, "p90": 90.0, "p99": 99.0, "p99_9": 99.9}
_BITS = 11  # that tell one duration from another
TAIL_SAMPLES = 100_000  # from so many on, p99.99 rests on ten samples or more


class Deadlines:
    """Outcomes of ticks that asked for an answer.

    Attributes:
        asked: ticks whose deadline has passed.
        in_time: answered by the deadline.
        late: answered after it.
        lost: not answered, so far.
        misses_in_a_row: now.
        longest_run: the most misses in a row.
        success_rate: share of answers in time over the last window; 1 before anything was asked.
        worst_window: lowest success rate of any full window, or None before the first.
    """

    def __init__(self, window: int = WINDOW) -> None:
        self.asked = self.in_time = self.late = self.lost = 0
        self.misses_in_a_row = self.longest_run = 0
        self.success_rate = 1.0
        self.worst_window: float | None = None
        self._window = [False] * window
        self._hits = 0

    @property
    def run_rate(self) -> float:
        """Share of answers in time since the start; 1 before anything was asked."""
        return self.in_time / self.asked if self.asked else 1.0

    def hit(self) -> None:
        """The answer was in time."""
        self._count(hit=True)
        self.in_time += 1
        self.misses_in_a_row = 0

    def miss(self, *, arrived: bool) -> None:
        """The deadline passed without an answer; `arrived` where it came after it."""
        self._count(hit=False)
        if arrived:
            self.late += 1
        else:
            self.lost += 1
        self.misses_in_a_row += 1
        self.longest_run = max(self.longest_run, self.misses_in_a_row)

    def lost_arrived(self) -> None:
        """An answer counted as lost has arrived after all: it was late."""
        self.lost -= 1
        self.late += 1

    def end_run(self) -> None:
        """Misses before this do not count towards a stop: the robot was told to start anew."""
        self.misses_in_a_row = 0

    def _count(self, *, hit: bool) -> None:
        window = self._window
        place = self.asked % len(window)
        self._hits += hit - window[place]
        window[place] = hit
        self.asked += 1
        full = self.asked >= len(window)
        self.success_rate = rate = self._hits / (len(window) if full else self.asked)
        if full and (self.worst_window is None or rate < self.worst_window):
            self.worst_window = rate


class Durations:
    """A histogram of durations, 1 ns to `highest`, with the worst ones and their ticks.

    Percentiles are those of the nearest rank, to a thousandth: up to 2047 ns each duration has a
    bin of its own, and from there on each doubling has 1024 of them.

    Args:
        highest: longest duration that is resolved [ns]; longer ones are counted as overflows.
        worst: how many of the longest are kept with their tick.

    Attributes:
        n, total: how many that are not negative, and their sum [ns].
        overflows, negative: longer ones, counted in n, and negative ones, which are not.
    """

    def __init__(self, highest: int = 10_000_000_000, worst: int = 10) -> None:
        self._bins = array("q", [0]) * (_bin(highest) + 1)  # in a list each count takes memory
        self._highest, self._keep = highest, worst
        self._worst: list[tuple[int, int]] = []
        self.n = self.total = self.overflows = self.negative = 0
        self._min = self._max = 0

    def add(self, nanoseconds: int, tick: int = 0) -> None:
        """Count a duration [ns]; negative ones are counted apart and enter no figure."""
        if nanoseconds < 0:
            self.negative += 1
            return
        self._min = min(self._min, nanoseconds) if self.n else nanoseconds
        self._max = max(self._max, nanoseconds)
        self.n += 1
        self.total += nanoseconds
        if nanoseconds > self._highest:
            self.overflows += 1
        self._bins[_bin(min(nanoseconds, self._highest))] += 1
        if len(self._worst) < self._keep:
            heapq.heappush(self._worst, (nanoseconds, tick))
        elif nanoseconds > self._worst[0][0]:
            heapq.heapreplace(self._worst, (nanoseconds, tick))

    def up_to(self, bounds: Sequence[int]) -> list[int]:
        """How many were not longer than each bound [ns], to the width of a bin."""
        counts = self._cumulated()
        return [int(counts[_bin(min(bound, self._highest))]) for bound in bounds]

    def summary(self) -> dict[str, Any]:
        """n, min, percentiles, max [us] and worst ticks; negative ones and overflows where any."""
        result: dict[str, Any] = {"n": self.n}
        if self.negative:
            result["negative"] = self.negative
        if not self.n:
            return result
        percentiles = dict(PERCENTILES)
        if self.n >= TAIL_SAMPLES:
            percentiles["p99_99"] = 99.99
        result["min"] = self._min / 1e3
        up_to = self._cumulated()
        for name, share in percentiles.items():
            value = _longest_in(int(np.searchsorted(up_to, rank(self.n, share))))
            result[name] = min(max(value, self._min), self._max) / 1e3
        result["max"] = self._max / 1e3
        result["worst"] = [
            {"us": value / 1e3, "tick": tick} for value, tick in sorted(self._worst, reverse=True)
        ]
        if self.overflows:
            result["overflows"] = self.overflows
        return result

    def _cumulated(self) -> npt.NDArray[np.int64]:
        """For each bin how many were not longer; a list would be a million bytes at each look."""
        return np.cumsum(np.frombuffer(self._bins, np.int64))


def rank(n: int, share: float) -> int:
    """Which of n values in order, from 1 on, a percentile is: the nearest rank, never rounded down.

    In whole numbers: 99.9 / 100 as a double is a little more, and would be the next of 1000.
    """
    return -(-n * round(share * 100) // 10_000)


def _bin(nanoseconds: int) -> int:
    """Number of a duration's bin, by its leading eleven bits."""
    coarse = max(0, nanoseconds.bit_length() - _BITS)
    return (coarse << _BITS - 1) + (nanoseconds >> coarse)


def _longest_in(number: int) -> int:
    """The longest duration of a bin [ns]."""
    coarse = max(0, (number >> _BITS - 1) - 1)
    return ((number - (coarse << _BITS - 1) + 1) << coarse) - 1


class Jitter:
    """Spread of a period about its nominal length: standard deviation, tail and maximum."""

    def __init__(self, period: int) -> None:
        self._period = period
        self._n = 0
        self._mean = self._squares = 0.0
        self._deviations = Durations()
        self._last: int | None = None

    def start(self, stamp: int) -> None:
        """A period begins at `stamp` [ns]."""
        if self._last is not None:
            deviation = float(stamp - self._last - self._period)
            self._n += 1
            step = deviation - self._mean
            self._mean += step / self._n
            self._squares += step * (deviation - self._mean)
            self._deviations.add(abs(int(deviation)))
        self._last = stamp

    def skip(self) -> None:
        """The next start does not follow the last one: ticks were skipped."""
        self._last = None

    def summary(self) -> dict[str, Any]:
        """n, standard deviation, p99.9 - p50 of |period - T|, and max |period - T| [us]."""
        if self._n < 2:
            return {"n": self._n}
        sizes = self._deviations.summary()
        return {
            "n": self._n,
            "std": (self._squares / (self._n - 1)) ** 0.5 / 1e3,
            "p99_9_minus_p50": sizes["p99_9"] - sizes["p50"],
            "max": sizes["max"],
        }
