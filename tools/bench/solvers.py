"""`hoap3 bench solvers`: Table I of the QP12 paper, with more peers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hoap3.remote_controller.solvers import Pinv
from hoap3.tools.bench.case_runner import Case, Report, reference, silent, time_cases
from hoap3.tools.bench.peers import PEERS, Array, Peer

GAMMA = 0.5
STREAM = 512  # problems that change a little at every call, as those of a loop do
PAPER_US = {
    "qp12": {"min_us": 1.259, "mean_us": 1.358, "max_us": 7.575},
    "pinv": {"min_us": 7.713, "mean_us": 12.04, "max_us": 35.15},
    "osqp": {"min_us": 29.64, "mean_us": 32.3, "max_us": 153.24},
}
"""Table I, on the authors' machine in Julia, in batches of ten."""


def bench_solvers(
    n: int = 21,
    samples: int = 10_000,
    gamma: float = GAMMA,
    report: Report = silent,
    peers: Mapping[str, Callable[[int, float], Peer]] = PEERS,
) -> list[dict[str, Any]]:
    """Rows {solver, n, samples, min_us, …} of `peers` and of `pinv`, timed in turn.

    `times_qp12` is how many times as long as ours one takes, `worst_error` how far its answers are
    from ours at the most, relative to the largest speed (for `pinv` from those by SVD).
    """
    solvers = {name: make(n, gamma) for name, make in peers.items()}
    problems = gradients(n)
    cases = [case(name, each, problems) for name, each in solvers.items()]
    errors = {name: worst_error(each, solvers["qp12"], problems) for name, each in solvers.items()}
    tasks = jacobians(n)
    cholesky, svd = _pinv(n), Peer(lambda jacobian, error: np.linalg.pinv(jacobian) @ error)
    cases += [case("pinv", cholesky, tasks), case("pinv_svd", svd, tasks)]
    errors["pinv"] = worst_error(cholesky, svd, tasks)
    times = time_cases([*cases, reference()], samples, report=report)
    return [
        {
            "solver": name,
            "n": n,
            **taken.figures(),
            "worst_error": errors.get(name),
            "times_qp12": taken.times(times["qp12"]),
            "paper": PAPER_US.get(name) if n == 21 else None,
        }
        for name, taken in times.items()
    ]


def case(name: str, solver: Peer, problems: Sequence[tuple[Any, ...]]) -> Case:
    """A solver with a stream of problems."""
    return Case(name, solver.solve, [(*problem, *solver.fixed) for problem in problems])


def worst_error(solver: Peer, exact: Peer, problems: Sequence[tuple[Any, ...]]) -> float:
    """Largest difference of any |u_i| between two solvers, relative to the largest."""

    def difference(problem: tuple[Any, ...]) -> float:
        ours, theirs = np.abs(exact(*problem)), np.abs(solver(*problem))
        return float(np.max(np.abs(ours - theirs)) / np.max(ours))

    return max(difference(problem) for problem in problems)


def _pinv(n: int) -> Peer:
    """Our pseudo-inverse, by Cholesky of the 3 × 3 matrix JJᵀ."""
    out: Array = np.zeros(n)
    return Peer(Pinv(3, n).solve_plain, (1.0, out), out)


def gradients(n: int, seed: int = 0) -> list[tuple[Array, float]]:
    """Positive gradients, (n,), and the decrease that each shall reach."""
    walk = np.abs(_walk(n, seed))
    return [(a, 0.1 * float(np.linalg.norm(a))) for a in walk]


def jacobians(n: int, seed: int = 1) -> list[tuple[Array, Array]]:
    """Jacobians of a task with three rows, (3, n), and its errors, (3,)."""
    walk = _walk(3 * n + 3, seed)
    return [(row[: 3 * n].reshape(3, n), row[3 * n :]) for row in walk]


def _walk(width: int, seed: int) -> Array:
    """A random walk, (STREAM, width), to and fro: walked through again it has no jump."""
    rng = np.random.default_rng(seed)
    steps = np.cumsum(rng.normal(scale=0.02, size=(STREAM // 2, width)), axis=0)
    walk = rng.normal(size=width) + steps
    return np.ascontiguousarray(np.vstack([walk, walk[::-1]]))
