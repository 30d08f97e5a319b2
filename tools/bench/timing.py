"""Timing of calls beside each other: single ones, and batches of ten as the paper's tool does."""

from __future__ import annotations

import gc
import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLOCKS = 100
BATCH = 10
SETTLE = 3  # calls that are not counted, after another contender had the caches

Array = NDArray[np.float64]
Report = Callable[[int, int], None]
"""Takes how much is done, and of how much."""


def silent(_done: int, _whole: int) -> None:
    """Show no progress."""


@dataclass(frozen=True)
class Contender:
    """Something to be timed: `call(*problem)` for one problem after the other, over and over."""

    name: str
    call: Callable[..., object]
    problems: Iterable[tuple[Any, ...]]


@dataclass(frozen=True)
class Times:
    """What a contender took [us].

    Attributes:
        single: of single calls, (blocks, calls).
        batch: per call, means of batches, (blocks,), or (0,) where there are none.
    """

    single: Array
    batch: Array

    def figures(self) -> dict[str, Any]:
        """Row of a benchmark: of single calls, and of batches where there are any."""
        us = self.single.ravel()
        found = {
            "samples": us.size,
            "min_us": float(us.min()),
            "mean_us": float(us.mean()),
            "p50_us": float(np.percentile(us, 50)),
            "p99_us": float(np.percentile(us, 99)),
            "max_us": float(us.max()),
        }
        if self.batch.size:
            found |= {
                "batches": self.batch.size,
                "batch_min_us": float(self.batch.min()),
                "batch_mean_us": float(np.median(self.batch)),
                "batch_max_us": float(self.batch.max()),
            }
        return found

    def times(self, reference: Times) -> float:
        """How many times as long as the reference: median of the ratios of each block's medians."""
        ours, theirs = np.median(self.single, axis=1), np.median(reference.single, axis=1)
        return float(np.median(ours / theirs))


def race(
    contenders: Sequence[Contender],
    samples: int,
    blocks: int = BLOCKS,
    *,
    batches: bool = True,
    report: Report = silent,
) -> dict[str, Times]:
    """Time all contenders in turn, block by block, so that a drift of the machine meets them all.

    In each block a contender makes a few calls that are not counted, `samples`/`blocks` single
    ones and a batch of ten. The arrays of its problems are read once before: a loop has just
    written those it hands to a solver, so fetching them is no part of a solve. Reading the clock,
    some 0.1 us, is part of single calls and a tenth of that in batches. Garbage collection is off
    meanwhile. The maximum belongs to the machine, not to the code: look at the medians.

    Args:
        contenders: what to time.
        samples: single calls of each, rounded down to whole blocks.
        blocks: at most; fewer where there are fewer samples.
        batches: whether there are any.
        report: is told between two blocks how many are done, and of how many.
    """
    blocks = min(blocks, samples)
    calls, ten = samples // blocks, BATCH if batches else 0
    problems = {each.name: itertools.cycle(each.problems) for each in contenders}
    single = {each.name: np.zeros((blocks, calls), np.int64) for each in contenders}
    batch = {each.name: np.zeros(blocks if batches else 0, np.int64) for each in contenders}
    with undisturbed():
        for block in range(blocks):
            report(block, blocks)
            for each in contenders:
                ahead = list(itertools.islice(problems[each.name], SETTLE + calls + ten))
                _read(ahead)
                _together(each.call, ahead[:SETTLE])
                single[each.name][block] = _singly(each.call, ahead[SETTLE : SETTLE + calls])
                if batches:
                    batch[each.name][block] = _together(each.call, ahead[SETTLE + calls :])
    return {
        each.name: Times(single[each.name] / 1e3, batch[each.name] / (1e3 * BATCH))
        for each in contenders
    }


def _read(value: object) -> None:
    """Bring every array in a problem, or in a list of problems, near the processor."""
    if isinstance(value, np.ndarray):
        value.tobytes()
    elif isinstance(value, list | tuple):
        for each in value:
            _read(each)
    elif hasattr(value, "indptr"):  # a sparse matrix
        _read([getattr(value, name) for name in ("data", "indices", "indptr")])
    elif is_dataclass(value):
        for field in fields(value):
            _read(getattr(value, field.name))


def _together(call: Callable[..., object], problems: list[tuple[Any, ...]]) -> int:
    """Nanoseconds of all calls."""
    now = time.perf_counter_ns
    begin = now()
    for problem in problems:
        call(*problem)
    return now() - begin


def _singly(call: Callable[..., object], problems: list[tuple[Any, ...]]) -> list[int]:
    """Nanoseconds of each call."""
    now, taken = time.perf_counter_ns, []
    for problem in problems:
        begin = now()
        call(*problem)
        taken.append(now() - begin)
    return taken


@contextmanager
def undisturbed() -> Iterator[None]:
    """No garbage collection meanwhile."""
    enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
