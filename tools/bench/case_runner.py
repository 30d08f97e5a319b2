"""Run benchmark cases in turn, and collect their figures with a reference and the machine.

Everything that compares two or more things here goes through `run_in_turn`, so that a drift of the
machine affects all of them alike: calls of solvers (`time_cases`), steps of controllers, blocks of
a link and whole runs of a robot.
"""

from __future__ import annotations

import gc
import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hoap3.tools.analysis.output import print_json, watch_compilation
from hoap3.tools.machine.machine import machine_block

BLOCKS = 100
BATCH = 10
SETTLE = 3  # calls that are not counted, after another case had the caches
REPETITIONS = 20  # of the reference

Array = NDArray[np.float64]
Row = dict[str, Any]
Report = Callable[[int, int], None]
"""Takes how much is done, and of how much."""

Result = TypeVar("Result")
Meter = TypeVar("Meter")


def silent(_done: int, _whole: int) -> None:
    """Show no progress."""


def run_benchmark(
    progress: AbstractContextManager[Meter],
    measure: Callable[[Meter], Row],
    show: Callable[[Row], None],
    *,
    as_json: bool,
) -> Row:
    """Measure, add the machine block, and print JSON or tables.

    Args:
        progress: shows how far the benchmark is; `measure` is given what it yields.
        measure: the benchmark; what it returns may have a `machine` block of its own.
        show: prints the result for people.
        as_json: whether to print one JSON object instead.
    """
    machine = machine_block()
    watch_compilation()
    with progress as meter:
        result = measure(meter)
    result.setdefault("machine", machine)
    if as_json:
        print_json(result)
    else:
        show(result)
    return result


def run_in_turn(
    cases: Mapping[str, Callable[[], Result]], rounds: int, *, alternate: bool = False
) -> Iterator[tuple[int, str, Result]]:
    """Run each case once in every round.

    Args:
        cases: what to run, by name.
        rounds: how many.
        alternate: whether the order is reversed in every second round.

    Yields:
        The round, the name of the case and what it returned.
    """
    for number in range(rounds):
        names = list(cases)
        for name in reversed(names) if alternate and number % 2 else names:
            yield number, name, cases[name]()


def median_ratio(ours: Iterable[float | None], theirs: Iterable[float | None]) -> float | None:
    """Median over the rounds of ours ÷ theirs; None where no round has both."""
    pairs = zip(ours, theirs, strict=True)
    ratios = [a / b for a, b in pairs if a is not None and b is not None]
    return float(np.median(ratios)) if ratios else None


@dataclass(frozen=True)
class Case:
    """A call to time: `call(*problem)` for one problem after the other, over and over."""

    name: str
    call: Callable[..., object]
    problems: Iterable[tuple[Any, ...]]


def reference() -> Case:
    """A fixed piece of work: its time tells how fast this machine is just now.

    Twenty rounds of a Python loop with a product of a 21 × 21 matrix and a vector in each.
    """
    matrix, vector, out = np.full((21, 21), 0.5), np.ones(21), np.zeros(21)

    def work() -> int:
        total = 0
        for k in range(REPETITIONS):
            total += k * k
            np.dot(matrix, vector, out)
        return total

    return Case("reference", work, [()])


@dataclass(frozen=True)
class Times:
    """What a case took [us].

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


def time_cases(
    cases: Sequence[Case],
    samples: int,
    blocks: int = BLOCKS,
    *,
    batches: bool = True,
    report: Report = silent,
) -> dict[str, Times]:
    """Time all cases in turn, block by block.

    In each block a case makes a few calls that are not counted, `samples`/`blocks` single ones
    and a batch of ten. The arrays of its problems are read once before: a loop has just written
    those it hands to a solver, so fetching them is no part of a solve. Reading the clock, some
    0.1 us, is part of single calls and a tenth of that in batches. Garbage collection is off
    meanwhile. The maximum belongs to the machine, not to the code: look at the medians.

    Args:
        cases: what to time.
        samples: single calls of each, rounded down to whole blocks.
        blocks: at most; fewer where there are fewer samples.
        batches: whether there are any.
        report: takes how many blocks of the first case are done, and of how many.
    """
    blocks = min(blocks, samples)
    turns = {
        each.name: partial(_block, each.call, itertools.cycle(each.problems), samples // blocks)
        for each in cases
    }
    if batches:
        turns = {name: partial(turn, batch=BATCH) for name, turn in turns.items()}
    single: dict[str, list[list[int]]] = {name: [] for name in turns}
    batch: dict[str, list[int]] = {name: [] for name in turns}
    with undisturbed():
        for block, name, (ones, ten) in run_in_turn(turns, blocks):
            single[name].append(ones)
            batch[name] += ten
            if name == cases[0].name:
                report(block, blocks)
    return {
        name: Times(np.array(single[name]) / 1e3, np.array(batch[name], float) / (1e3 * BATCH))
        for name in turns
    }


def _block(
    call: Callable[..., object], problems: Iterator[tuple[Any, ...]], calls: int, batch: int = 0
) -> tuple[list[int], list[int]]:
    """Nanoseconds of so many single calls, and of a batch, where there is any."""
    ahead = list(itertools.islice(problems, SETTLE + calls + batch))
    _read(ahead)
    _together(call, ahead[:SETTLE])
    single = _singly(call, ahead[SETTLE : SETTLE + calls])
    return single, [_together(call, ahead[SETTLE + calls :])] if batch else []


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
