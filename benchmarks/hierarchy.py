"""`python -m benchmarks.hierarchy`: hierarchical control, and (13) as it is printed."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import qp_peers
from benchmarks.command import Calls, Plot, Quick, main, show_missing, show_ratio
from benchmarks.hierarchy_problems import FRAMES, bounds, moments, program
from benchmarks.hierarchy_problems import missing as missing_robots
from benchmarks.plot import check_picture, draw_hierarchies
from hoap3.remote_controller.solvers import Ghc
from hoap3.tools.analysis.output import progress
from hoap3.tools.bench.case_runner import Case, Times, run_benchmark, time_cases
from hoap3.tools.bench.cycle import motion
from hoap3.tools.bench.show import FEWER, SINGLE, number, numbers, show_table, words
from hoap3.tools.cli.options import AsJson
from hoap3.tools.reproduce.papers.ghc import times as paper
from hoap3.tools.reproduce.papers.ghc.times import (
    HEADLINE,
    OURS,
    TASKS,
    W_R,
    Moment,
    Problem,
    hierarchies,
)

Array = NDArray[np.float64]
Limits = tuple[Array, Array] | None

PEERS = ("daqp", "quadprog")
"""Those for (13), which is too large for the others."""

TOLERANCE = 1e-9
ALONE = 20
"""Ours is timed once more, alone, so many times as often: the plain program takes milliseconds."""

QUICK_TASKS = (2, 5)
BLOCKS = 20
MOTIONS = {
    "lwr": ("lwr_weightless", "ghc"),
    "humanoid32": ("humanoid32_torque", "ghc_humanoid"),
}
"""Configs of robot and controller whose whole ticks are timed; iCub has none."""

MOTION_S = 2.0
PAPER_MS = paper.PAPER_MS | {"icub": 88.0}


def bench_hierarchy(
    samples: int = 200,
    tasks: Sequence[int] = TASKS,
    robots: Sequence[str] = tuple(FRAMES),
    report: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Time `Ghc` and its peers on the same problems, in turn.

    Args:
        samples: single calls of each peer; ours is called `ALONE` times as often.
        tasks: numbers of tasks.
        robots: keys of `FRAMES`; those that are `missing` are left out.
        report: is told what is timed next.

    Returns:
        `rows`, and `ratios`, {robot, n, case, tasks, best_peer, times_ghc, times_ghc_min} of
        `HEADLINE` tasks.
    """
    rows = []
    for robot in (each for each in robots if each not in missing_robots()):
        walk = moments(robot)
        for case in ("free", "bounded"):
            for k in tasks:
                report(f"{robot}, {k} tasks, {case}")
                rows += _rows(robot, case, hierarchies(walk, k), k, samples)
            if HEADLINE in tasks:
                rows += _mixed(robot, case, walk, samples)
        if robot in MOTIONS:
            report(f"{robot}, whole ticks")
            rows.append(_ticks(robot, samples))
    return {"rows": rows, "ratios": ratios(rows)}


def missing() -> dict[str, str]:
    """Peers and robots that are not installed, and their packages."""
    return qp_peers.missing(PEERS) | missing_robots()


def ratios(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """How many times as long as ours the quickest peer takes, for `HEADLINE` tasks."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for row in rows:
        if row["solver"] in PEERS and row["tasks"] == HEADLINE:
            key = row["robot"], row["case"]
            if key not in found or row["times_ghc"] < found[key]["times_ghc"]:
                wanted = ("robot", "n", "case", "tasks", "times_ghc", "times_ghc_min")
                found[key] = {"best_peer": row["solver"]} | {name: row[name] for name in wanted}
    return list(found.values())


def _rows(
    robot: str, case: str, problems: list[Problem], k: int, samples: int
) -> list[dict[str, Any]]:
    call, given, told = _ours(problems, case == "bounded")
    ours = Case(OURS, call, given)
    programs = [program(*each) for each in given]
    peers = {
        name: [(make(it), TOLERANCE) for it in programs]
        for name, make in qp_peers.installed(PEERS).items()
    }
    others = [Case(name, operator.call, bound) for name, bound in peers.items()]
    beside = time_cases([ours, *others], samples, BLOCKS, batches=False)
    alone = time_cases([ours], ALONE * samples, batches=False)[OURS]
    common = {"robot": robot, "n": problems[0].bias.size, "tasks": k, "case": case}
    least = float(beside[OURS].single.min())
    found = [_row(OURS, common, alone, 1.0, 1.0) | told]
    for name, bound in peers.items():
        worst = max(
            _error(call(*each).copy(), it.motion @ solve(tolerance)[1])
            for each, it, (solve, tolerance) in zip(given, programs, bound, strict=True)
        )
        taken = beside[name]
        times = taken.times(beside[OURS]), float(taken.single.min()) / least
        found.append(_row(name, common, taken, *times) | {"worst_error": worst})
    return found


def _mixed(robot: str, case: str, walk: list[Moment], samples: int) -> list[dict[str, Any]]:
    """Ours once more, with every priority somewhere between 0 and 1."""
    call, given, told = _ours(hierarchies(walk, HEADLINE, seed=1), case == "bounded")
    name = f"{OURS}, mixed"
    taken = time_cases([Case(name, call, given)], ALONE * samples, batches=False)[name]
    common = {"robot": robot, "n": walk[0].bias.size, "tasks": HEADLINE, "case": case}
    return [_row(name, common, taken, None, None) | told]


def _ticks(robot: str, samples: int) -> dict[str, Any]:
    """Whole steps of the controller `ghc`: dynamics, tasks, bounds, answer and certificate."""
    emulator, controller = MOTIONS[robot]
    law, states = motion(emulator, controller, MOTION_S)
    name = f"{OURS} tick"
    case = Case(name, law.step, [(state,) for state in states])
    taken = time_cases([case], ALONE * samples, batches=False)[name]
    tasks, n = len(law.tasks.names), law.description.n
    common = {"robot": robot, "n": n, "tasks": tasks, "case": controller}
    return _row(name, common, taken, None, None)


def _row(
    name: str,
    common: dict[str, Any],
    taken: Times,
    times: float | None,
    times_min: float | None,
) -> dict[str, Any]:
    printed = name == OURS and common["case"] == "free" and common["tasks"] == HEADLINE
    return {
        "solver": name,
        **common,
        **taken.figures(),
        "times_ghc": times,
        "times_ghc_min": times_min,
        "worst_error": None,
        "worst_residual": None,
        "active_mean": None,
        "active_max": None,
        "paper": {"mean_us": 1e3 * PAPER_MS[common["robot"]]} if printed else None,
    }


def _ours(
    problems: list[Problem], bounded: bool
) -> tuple[Callable[..., Array], list[tuple[Problem, Limits]], dict[str, Any]]:
    """Our solver as a loop calls it, what with, and what its answers are like."""
    solver = Ghc(problems[0].sizes, problems[0].bias.size)

    def call(it: Problem, most: Limits) -> Array:
        if most is not None:
            solver.qdd_upper[:], solver.tau_upper[:] = most
            np.negative(most[0], solver.qdd_lower)
            np.negative(most[1], solver.tau_lower)
        solver.solve(it.jacobian, it.targets, it.alpha, it.mass, it.bias, W_R)
        answer: Array = solver.qdd
        return answer

    given: list[tuple[Problem, Limits]] = []
    for each in problems:
        free = call(each, None)
        given.append((each, bounds(each, free, solver.tau) if bounded else None))
    told = []
    for each, most in given:
        call(each, most)
        told.append((solver.active, solver.kkt_residual))
        solver.qdd_upper[:] = solver.tau_upper[:] = math.inf
        solver.qdd_lower[:] = solver.tau_lower[:] = -math.inf
    active, residuals = zip(*told, strict=True)
    said = {
        "active_mean": float(np.mean(active)),
        "active_max": max(active),
        "worst_residual": max(residuals),
    }
    return call, given, said


def _error(found: Array, right: Array) -> float:
    return float(np.abs(found - right).max() / np.abs(right).max())


def show_hierarchies(measured: dict[str, Any]) -> None:
    """Print a row a solver, and the ratios below."""

    def cells(row: dict[str, Any]) -> dict[str, str]:
        return {
            **words(row, "solver", "robot", "tasks", "case", "samples"),
            **numbers(row, ".1f", *FEWER, "times_ghc"),
            "active": number(row["active_mean"], ".1f"),
        }

    show_table(f"{SINGLE}hierarchies of tasks", measured["rows"], cells, measured["machine"])
    for row in measured["ratios"]:
        what = f"{row['robot']}, {row['tasks']} tasks, {row['case']}: {row['best_peer']}"
        show_ratio(what, row["times_ghc"], row["times_ghc_min"])
    show_missing(missing())


def command(
    samples: Calls = 200, quick: Quick = False, plot: Plot = None, as_json: AsJson = False
) -> None:
    """Time hierarchies of 1 to 7 tasks for 7 and 32 joints, and the plain program (13)."""
    if plot is not None:
        check_picture(plot)
    calls, tasks = (10, QUICK_TASKS) if quick else (samples, TASKS)
    measured = run_benchmark(
        progress("hierarchy"),
        lambda meter: {
            **bench_hierarchy(calls, tasks, report=meter.step),
            "missing": list(missing()),
        },
        show_hierarchies,
        as_json=as_json,
    )
    if plot is not None:
        draw_hierarchies(measured, plot)


if __name__ == "__main__":
    main(command)
