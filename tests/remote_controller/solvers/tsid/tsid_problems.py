"""Random QPs of task-space inverse dynamics, with rows or without; answers by quadprog."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import quadprog
from scipy.optimize import linprog

from hoap3.remote_controller.solvers.tsid.tsid import Tsid


@dataclass
class Problem:
    J: np.ndarray
    y: np.ndarray
    w: float
    p: np.ndarray
    M: np.ndarray
    h: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    effort: np.ndarray
    R: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    least: np.ndarray = field(default_factory=lambda: np.zeros(0))
    most: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        self.R = self.R.reshape(-1, len(self.p))

    def solver(self) -> Tsid:
        made = Tsid(self.effort, rows=len(self.R))
        made.rows[:], made.rows_lower[:], made.rows_upper[:] = self.R, self.least, self.most
        return made

    @property
    def arrays(self) -> tuple:
        return (self.J, self.y, self.w, self.p, self.M, self.h, self.lower, self.upper)

    def solve(self) -> tuple[int, Tsid]:
        solver = self.solver()
        return solver.solve(*self.arrays), solver

    @property
    def cost(self) -> tuple[np.ndarray, np.ndarray]:
        """H and f of ½ qᵀHq − fᵀq."""
        one = np.eye(len(self.p))
        return self.J.T @ self.J + self.w * one, self.J.T @ self.y + self.w * self.p


def problem(seed: int, n: int = 7, strength: float = 3.0) -> Problem:
    """Of any scale; some bounds meet, and efforts around exp(`strength`) may be too small."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n)) * np.exp(rng.normal(size=n))
    lower, upper = -np.exp(2 * rng.normal(size=n)), np.exp(2 * rng.normal(size=n))
    meet = rng.random(n) < 0.1
    lower[meet] = upper[meet]
    return Problem(
        J=rng.normal(size=(6, n)),
        y=10 * rng.normal(size=6),
        w=10 ** rng.uniform(-4, 0),
        p=10 * rng.normal(size=n),
        M=root @ root.T + 0.1 * np.eye(n),
        h=5 * rng.normal(size=n),
        lower=lower,
        upper=upper,
        effort=np.exp(rng.normal(size=n) + strength),
    )


def with_rows(seed: int, n: int, strength: float = 3.0) -> Problem:
    """The same with rows of any scale: some off, one-sided, equations, or a copy of another.

    Half of the problems have a point within bounds and rows; where the efforts allow that is open.
    """
    it, rng = problem(seed, n, strength), np.random.default_rng([seed, 1])
    s = int(rng.integers(1, n + 2))
    it.R = rng.normal(size=(s, n)) * np.exp(rng.normal(size=(s, 1)))
    it.R[rng.random((s, n)) < 0.3] = 0.0
    if s > 1 and rng.random() < 0.3:
        it.R[-1] = -2.0 * it.R[0]
    inside = it.lower + rng.random(n) * (it.upper - it.lower)
    size = np.linalg.norm(it.R, axis=1)
    middle = it.R @ inside if rng.random() < 0.5 else size * rng.normal(size=s)
    it.least, it.most = middle - size * rng.exponential(size=s), middle + size * rng.random(s)
    it.most[rng.random(s) < 0.2] = np.inf
    it.least[rng.random(s) < 0.2] = -np.inf
    equation = rng.random(s) < 0.15
    it.least[equation] = it.most[equation] = middle[equation]
    return it


def sides(it: Problem) -> tuple[np.ndarray, np.ndarray, int]:
    """Bounds and rows R as C·q ≥ c, of which the first so many are equations."""
    one, meet, equal = np.eye(len(it.p)), it.lower == it.upper, it.least == it.most
    lower, upper = (it.least > -np.inf) & ~equal, (it.most < np.inf) & ~equal
    C = [one[meet], it.R[equal], one[~meet], -one[~meet], it.R[lower], -it.R[upper]]
    c = [it.lower[meet], it.least[equal], it.lower[~meet], -it.upper[~meet]]
    c += [it.least[lower], -it.most[upper]]
    return np.vstack(C), np.concatenate(c), int(meet.sum() + equal.sum())


def by_quadprog(it: Problem) -> np.ndarray | None:
    """The solution, by Goldfarb and Idnani; None where there is none."""
    C, c, equations = sides(it)
    C = np.vstack([C, it.M, -it.M])
    c = np.concatenate([c, -it.effort - it.h, it.h - it.effort])
    try:
        return quadprog.solve_qp(*it.cost, C.T, c, equations)[0]
    except ValueError:  # constraints are inconsistent
        return None


def exceeding(it: Problem, weight: float) -> np.ndarray:
    """The best ddq where efforts may be exceeded at that weight, by quadprog."""
    (H, f), (C, c, equations) = it.cost, sides(it)
    n = len(f)
    one, zero = np.eye(n), np.zeros((n, n))
    S = np.diag(it.effort) / np.sqrt(weight * H.diagonal().max())
    rows = np.block([[C, np.zeros((len(C), n))], [it.M, S], [-it.M, S]])
    c = np.concatenate([c, -it.effort - it.h, it.h - it.effort])
    H, f = np.block([[H, zero], [zero, one]]), np.r_[f, np.zeros(n)]
    return quadprog.solve_qp(H, f, rows.T, c, equations)[0][:n]


def cost(it: Problem, ddq: np.ndarray, weight: float) -> float:
    """Of the task and of exceeded efforts."""
    task = np.sum((it.y - it.J @ ddq) ** 2) + it.w * np.sum((it.p - ddq) ** 2)
    largest = (it.J.T @ it.J).diagonal().max() + it.w
    beyond = np.maximum(0.0, np.abs(it.M @ ddq + it.h) / it.effort - 1.0)
    return float(task + weight * largest * (beyond @ beyond))


def least_excess(it: Problem, efforts: bool) -> float:
    """By how much bounds and rows, and the efforts if asked for, must be exceeded, by an LP.

    Each side counts relative to the size of its row, efforts to themselves; negative is room left.
    """
    C, c, equations = sides(it)
    size = np.maximum(np.linalg.norm(C, axis=1), 1e-9)
    C, c = C / size[:, None], c / size
    C, c = np.vstack([C, -C[:equations]]), np.concatenate([c, -c[:equations]])
    if efforts:
        C = np.vstack([C, it.M / it.effort[:, None], -it.M / it.effort[:, None]])
        c = np.concatenate([c, -1.0 - it.h / it.effort, it.h / it.effort - 1.0])
    n = len(it.p)
    found = linprog(
        np.r_[np.zeros(n), 1.0],
        A_ub=-np.hstack([C, np.ones((len(C), 1))]),
        b_ub=-c,
        bounds=[(None, None)] * (n + 1),
        method="highs-ds",
    )
    return float(found.x[-1])
