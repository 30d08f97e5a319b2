"""Constrained problems of `benchmarks.solvers`: QP12 with bounds, and the general problem (3)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.qp_peers import Maker
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp.max_descent_lp import MaxDescentLp
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import QP, StableQp
from hoap3.remote_controller.solvers.qp.dense_qp import EQUATION, Program
from hoap3.remote_controller.solvers.qp12.bounded_qp12_kernels import (
    bounded_qp12_kernel,
    work_shape,
)
from hoap3.tools.bench.case_runner import Case, Report, reference, silent, time_cases

Array = NDArray[np.float64]
Problem = tuple[Array, float, float, Array, Array, Array, Array]

TOLERANCE = 1e-7
ROWS, STREAM, AT_LIMIT = 5, 256, 32
CLOSE = 1e-6
"""An answer that far from ours, relative to the largest speed, or farther, is a failure."""
CERTAIN = 1e-8  # of the KKT residual of our answers


def bench_general(
    n: int,
    samples: int,
    gamma: float,
    peers: Mapping[str, Maker],
    report: Report = silent,
) -> list[dict[str, Any]]:
    """Rows {solver, n, samples, min_us, …, failures, times_daqp}, timed in turn.

    "bounded qp12" is exact clamping; "stable_qp …" are whole solves, all checks and certificate
    included, of problems that need the QP ("feasible": ρ = 1 is) or the LP and a second QP
    ("limited": ρ < 1). The others get one of the former, ready-made, as their arrays and solve it
    once, cold: "daqp" is what `stable_qp` calls, timed bare.

    Args:
        n: joints, each with two bounds; 5 rows and the Lyapunov equality come on top.
        samples: single calls of each; of as many problems, but 256 at most.
        gamma: of the objective.
        peers: solvers of a program, with "daqp" among them.
        report: takes how much is done, and of how much.

    Returns:
        The rows. `failures` are answers out of `problems`: ours that were not found or have a KKT
        residual above 1e-8, others' that were not found or differ from ours by 1e-6 of the
        largest speed; `failures_at_limit` those with ρ at 1 − 1e-9 of ρ*. `times_daqp` is the
        ratio to daqp's bare call in this run.
    """
    count, count_at_limit = min(STREAM, samples), min(AT_LIMIT, samples)
    problems = {kind: stream(n, gamma, kind, count=count) for kind in ("feasible", "limited")}
    clamped = clamped_stream(n, gamma, np.zeros(n), count=count)
    cases = [Case("bounded qp12", bounded_qp12_kernel, clamped)]
    failures = {"bounded qp12": sum(not _proved(each) for each in clamped)}
    for kind, given in problems.items():
        solver = StableQp(n, ROWS, gamma=gamma)
        name = f"stable_qp, {kind}"
        failures[name] = sum(
            solver.solve(*each) != status.OK or not solver.kkt_residual <= CERTAIN for each in given
        )
        cases.append(Case(name, solver.solve, given))
    feasible = [_judged(each, gamma) for each in problems["feasible"]]
    limited = stream(n, gamma, "limited", count=count_at_limit)
    at_limit = [_judged(each, gamma) for each in limited]
    failures_at_limit: dict[str, int] = {}
    for name, make in peers.items():
        call = partial(_solved_by, make)
        failures[name] = sum(not _close(call(program), u) for program, u in feasible)
        failures_at_limit[name] = sum(not _close(call(program), u) for program, u in at_limit)
        cases.append(Case(name, call, [(program,) for program, _ in feasible]))
    times = time_cases([*cases, reference()], samples, report=report)
    return [
        {
            "solver": name,
            "n": n,
            **taken.figures(),
            "problems": count,
            "failures": failures.get(name),
            "problems_at_limit": count_at_limit,
            "failures_at_limit": failures_at_limit.get(name),
            "times_daqp": taken.times(times["daqp"]),
        }
        for name, taken in times.items()
    ]


def stream(
    n: int, gamma: float, kind: str = "feasible", seed: int = 0, count: int | None = None
) -> list[Problem]:
    """Random problems for `StableQp.solve` that need its QP; with "limited" ρ* is 0.3 to 0.99."""
    rng = np.random.default_rng(seed)
    solver, steepest = StableQp(n, ROWS, gamma=gamma), MaxDescentLp(n, ROWS, 0)
    none = np.zeros((0, n)), np.zeros(0)
    found: list[Problem] = []
    while len(found) < (STREAM if count is None else count):
        gradient, A = rng.normal(size=n), rng.normal(size=(ROWS, n))
        upper, lower = rng.uniform(0.1, 1, n), -rng.uniform(0.1, 1, n)
        inside = rng.uniform(lower, upper) * rng.random()
        if gradient @ inside > 0.0:
            gradient = -gradient
        b = np.maximum(0.0, A @ inside) + rng.uniform(0, 0.3, ROWS) * (rng.random(ROWS) < 0.7)
        psi = float(-gradient @ inside)
        if kind == "limited":
            steepest.fill(gradient, A, b, *none, lower, upper)
            psi = steepest.fall()[1] * steepest.top / rng.uniform(0.3, 0.99)
        each = (gradient, psi, 0.0, A, b, lower, upper)
        if solver.solve(*each) == status.OK and solver.path == QP:
            found.append(each)
    return found


def clamped_stream(
    n: int, gamma: float, out: Array, seed: int = 1, count: int | None = None
) -> list[tuple[Any, ...]]:
    """Problems for `bounded_qp12_kernel`: 0 to all joints but one are clamped."""
    rng, work = np.random.default_rng(seed), np.ones(work_shape(n))
    found = []
    for share in np.linspace(0.05, 0.95, STREAM if count is None else count):
        gradient, upper = rng.normal(size=n), rng.uniform(0.1, 1, n)
        lower = -rng.uniform(0.1, 1, n)
        most = float(np.sum(np.abs(gradient) * np.where(gradient > 0, -lower, upper)))
        found.append((gradient, share * most, gamma, lower, upper, work, out))
    return found


def _proved(problem: tuple[Any, ...]) -> bool:
    residual: float = bounded_qp12_kernel(*problem)  # negative: a status, no answer
    return 0.0 <= residual <= CERTAIN


def _judged(problem: Problem, gamma: float) -> tuple[Program, Array]:
    """The QP for others, with the ρ that we found, and our answer."""
    gradient, psi, drift, A, b, lower, upper = problem
    solver = StableQp(gradient.size, ROWS, gamma=gamma)
    solver.solve(*problem)
    return ready((gradient, solver.rho * psi, drift, A, b, lower, upper), gamma), solver.u


def ready(problem: Problem, gamma: float) -> Program:
    """The QP of a problem in p and m, u = p − m, as one would write it down for a solver."""
    gradient, psi, drift, A, b, lower, upper = problem
    n, top = gradient.size, float(np.abs(gradient).max())
    rows = np.vstack([A, gradient / top])
    target = -(psi + drift) / top
    sense = np.zeros(2 * n + rows.shape[0], np.int32)
    sense[-1] = EQUATION
    return Program(
        np.eye(2 * n),
        np.full(2 * n, gamma / (1.0 - gamma)),
        np.ascontiguousarray(np.hstack([rows, -rows])),
        np.concatenate([np.zeros(2 * n), np.full(b.size, -1e30), [target]]),
        np.concatenate([upper, -lower, b, [target]]),
        sense,
    )


def _solved_by(make: Maker, program: Program) -> Array:
    """The answer u of a solver to a program, NaN where it gave up."""
    solved, x, _ = make(program)(TOLERANCE)
    half = x.size // 2
    return x[:half] - x[half:] if solved else np.full(half, math.nan)


def _close(u: Array, exact: Array) -> bool:
    return bool(np.abs(u - exact).max() <= CLOSE * np.abs(exact).max())
