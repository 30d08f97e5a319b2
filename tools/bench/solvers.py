"""`hoap3 bench solvers`: Table I of the QP12 paper, with more peers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hoap3.remote_controller.solvers import Pinv
from hoap3.tools.bench.peers import Peer, installed, peer
from hoap3.tools.bench.problems.streams import Array, gradients, jacobians
from hoap3.tools.bench.reference import reference
from hoap3.tools.bench.timing import Contender, Report, race, silent

GAMMA = 0.5
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
) -> list[dict[str, Any]]:
    """Rows {solver, n, samples, min_us, …} of every solver that is installed, timed in turn.

    `times_qp12` is how many times as long as ours one takes, `worst_error` how far its answers are
    from ours at the most, relative to the largest speed (for `pinv` from those by SVD).
    """
    solvers = {name: peer(name, n, gamma) for name in installed()}
    problems = gradients(n)
    contenders = [contender(name, each, problems) for name, each in solvers.items()]
    errors = {name: worst_error(each, solvers["qp12"], problems) for name, each in solvers.items()}
    tasks = jacobians(n)
    cholesky, svd = _pinv(n), Peer(lambda jacobian, error: np.linalg.pinv(jacobian) @ error)
    contenders += [contender("pinv", cholesky, tasks), contender("pinv_svd", svd, tasks)]
    errors["pinv"] = worst_error(cholesky, svd, tasks)
    times = race([*contenders, reference()], samples, report=report)
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


def contender(name: str, solver: Peer, problems: Sequence[tuple[Any, ...]]) -> Contender:
    """A solver with a stream of problems."""
    return Contender(name, solver.solve, [(*problem, *solver.fixed) for problem in problems])


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
