"""`python -m benchmarks.scaling`: how the time of each solver grows with the number of joints."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.command import Plot, main, show_missing
from benchmarks.plot import FIT_FROM, check_picture, draw_scaling
from benchmarks.qp12_peers import installed, missing, peer
from hoap3.tools.analysis.output import progress, results
from hoap3.tools.bench.case_runner import Case, run_benchmark, time_cases
from hoap3.tools.bench.peers import Peer
from hoap3.tools.bench.show import numbers, show_table
from hoap3.tools.bench.solvers import GAMMA, case, gradients
from hoap3.tools.cli.options import AsJson

SIZES = (7, 14, 21, 32, 50, 100, 200, 500, 1000)
BLOCKS = 30
SLOW_S, SLOW_SAMPLES = 2e-3, 5
"""A solver that needs longer for one problem is timed that often only."""

LONGEST_S = 1.0
"""A solver that needs longer than this is left out, also of larger sizes."""


def bench_scaling(
    samples: int = 300,
    sizes: Iterable[int] = SIZES,
    solvers: Sequence[str] | None = None,
    report: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Time solvers over the number of joints, all of them and all sizes in turn.

    Args:
        samples: single calls of each solver at each size; few of slow ones.
        sizes: numbers of joints.
        solvers: names of `peers.PEERS`; all that are installed by default.
        report: is told what is timed next.

    Returns:
        `rows` as those of `bench_solvers`; `slopes`, of each solver that has two sizes or more from
        `FIT_FROM` joints on; `left_out`, {solver, n, took_s} of what was too slow.
    """
    names = list(installed() if solvers is None else solvers)
    found: dict[str, tuple[str, int]] = {}
    quick: list[Case] = []
    slow: list[Case] = []
    left_out: list[dict[str, Any]] = []
    for n in sorted(sizes):
        problems = gradients(n)
        for name in list(names):
            report(f"setting up {name} for {n} joints")
            solver = peer(name, n, GAMMA)
            took = _slowest(solver, problems[:3])
            if took > LONGEST_S:
                left_out.append({"solver": name, "n": n, "took_s": took})
                names.remove(name)
                continue
            label = f"{name}, {n} joints"
            found[label] = name, n
            (slow if took > SLOW_S else quick).append(case(label, solver, problems))

    def timing(done: int, whole: int) -> None:
        report(f"timing, {100 * done // whole} %")

    times = time_cases(quick, samples, BLOCKS, batches=False, report=timing)
    if slow:
        report("timing those that are slow")
    times |= time_cases(slow, min(samples, SLOW_SAMPLES), 1, batches=False)
    rows = [
        {"solver": name, "n": n, **times[label].figures()} for label, (name, n) in found.items()
    ]
    return {"rows": rows, "slopes": slopes(rows), "left_out": left_out}


def slopes(rows: Iterable[dict[str, Any]]) -> dict[str, float]:
    """Exponent p of the median time ~ n^p of each solver, for `FIT_FROM` joints and more."""
    points: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        if row["n"] >= FIT_FROM:
            points.setdefault(row["solver"], []).append((row["n"], row["p50_us"]))
    return {name: slope(*zip(*found, strict=True)) for name, found in points.items() if found[1:]}


def slope(sizes: Sequence[float], times: Sequence[float]) -> float:
    """Slope of a straight line through log(time) over log(size), by least squares."""
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])


def _slowest(solver: Peer, problems: Sequence[tuple[Any, ...]]) -> float:
    """Seconds of the slowest of these calls but for the first one, which may set something up."""
    taken = []
    for problem in problems:
        start = time.perf_counter()
        solver(*problem)
        taken.append(time.perf_counter() - start)
    return max(taken[1:])


def show_scaling(measured: dict[str, Any]) -> None:
    """Print medians, a row a number of joints, and the slopes below them."""
    rows = measured["rows"]
    solvers = list(dict.fromkeys(row["solver"] for row in rows))
    medians = {(row["n"], row["solver"]): row["p50_us"] for row in rows}
    lines: list[tuple[Any, dict[str, Any]]] = [
        (n, {name: medians.get((n, name)) for name in solvers})
        for n in sorted({row["n"] for row in rows})
    ]
    lines.append(("slope", {name: measured["slopes"].get(name) for name in solvers}))
    show_table(
        "median us of single calls",
        lines,
        lambda line: {"n": str(line[0]), **numbers(line[1], ".2f", *solvers)},
        measured["machine"],
    )
    results.print(f"Slopes of log(time) over log(n), from {FIT_FROM} joints on.", style="dim")
    for out in measured["left_out"]:
        text = f"Left out from {out['n']} joints on: {out['solver']}, {out['took_s']:.2g} s a call."
        results.print(text, style="dim")
    show_missing(missing())


def command(
    samples: Annotated[int, typer.Option(min=10, help="Calls of each that are timed.")] = 300,
    most: Annotated[
        int, typer.Option("--most", min=7, max=1000, help="Joints of the largest problem.")
    ] = 1000,
    plot: Plot = None,
    as_json: AsJson = False,
) -> None:
    """Time QP12 and its peers from 7 to 1000 joints, and fit how fast each grows."""
    if plot is not None:
        check_picture(plot)
    sizes = [n for n in SIZES if n <= most]
    measured = run_benchmark(
        progress("scaling"),
        lambda meter: {
            **bench_scaling(samples, sizes, report=meter.step),
            "missing": list(missing()),
        },
        show_scaling,
        as_json=as_json,
    )
    if plot is not None:
        draw_scaling(measured, plot)


if __name__ == "__main__":
    main(command)
