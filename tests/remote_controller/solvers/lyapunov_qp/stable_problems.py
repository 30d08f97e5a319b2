"""Random problems (3), and judges that know nothing of our solver."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import quadprog
from numpy.typing import NDArray
from scipy.optimize import linprog, lsq_linear

Array = NDArray[np.float64]
N, M = 21, 5


@dataclass(frozen=True)
class Problem:
    """(3) with QP12's objective; Ψ such that ρ = 1 is feasible, barely feasible, or not."""

    gradient: Array
    psi: float
    A: Array
    b: Array
    lower: Array
    upper: Array
    gamma: float = 0.5
    drift: float = 0.0

    @property
    def arguments(self) -> tuple[Array, float, float, Array, Array, Array, Array]:
        """As `StableQp.solve` takes them."""
        return self.gradient, self.psi, self.drift, self.A, self.b, self.lower, self.upper

    @property
    def top(self) -> float:
        return float(np.abs(self.gradient).max())


def generic(seed: int, count: int, n: int = N, m: int = M) -> Iterator[Problem]:
    """ρ = 1 is feasible: a known u does it, at which some rows are active."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        gradient, A = rng.normal(size=n) * 10.0 ** rng.uniform(-3, 2), rng.normal(size=(m, n))
        upper, lower = rng.uniform(0.05, 1, n), -rng.uniform(0.05, 1, n)
        inside = rng.uniform(lower, upper) * rng.random()
        if gradient @ inside > 0.0:
            gradient = -gradient
        slack = rng.uniform(0, 0.3, m) * (rng.random(m) < 0.6)
        b = np.maximum(0.0, A @ inside) + slack
        gamma = float(rng.choice([0.0, 0.1, 0.5, 0.5, 0.9, 0.99]))
        yield Problem(gradient, float(-gradient @ inside), A, b, lower, upper, gamma)


def degenerate(seed: int, count: int) -> Iterator[tuple[str, Problem]]:
    """In turn: ρ = ρ*, near it, duplicated rows and pairs that leave no room, joints saturated."""
    rng = np.random.default_rng(seed)
    for i, given in enumerate(generic(seed + 1, count)):
        kind = ("vertex", "near", "duplicated", "saturated", "beyond")[i % 5]
        problem = given
        A, b = given.A.copy(), given.b.copy()
        if kind == "duplicated":
            A[1], b[1] = A[0], b[0]
            A[3], b[2:4] = -A[2], 0.0
            problem = replace(given, A=A, b=b)
        elif kind == "saturated":
            stuck = rng.random(N) < 0.3
            problem = replace(given, upper=np.where(stuck, 0.0, given.upper))
        most = most_descent(problem)
        share = {
            "vertex": 1.0,
            "near": 1 - 10.0 ** rng.uniform(-9, -4),
            "duplicated": rng.choice([1.0, 0.9, 0.5]),
            "saturated": rng.uniform(0.5, 0.999),
            "beyond": rng.uniform(1, 10),
        }[kind]
        yield kind, replace(problem, psi=most * share)


def most_descent(problem: Problem) -> float:
    """Largest −∇V·u, by HiGHS."""
    bounds = np.column_stack([problem.lower, problem.upper])
    slope = problem.gradient / problem.top
    found = linprog(slope, A_ub=problem.A, b_ub=problem.b, bounds=bounds, method="highs-ds")
    assert found.status == 0
    return float(-found.fun * problem.top)


def by_quadprog(problem: Problem, rate: float) -> Array | None:
    """The u with ∇V·u = rate, in the variables p − m; None where quadprog sees no answer."""
    n, m = problem.gradient.size, problem.b.size
    slope = problem.gradient / problem.top
    constraints = np.column_stack(
        [
            np.concatenate([slope, -slope]),
            -np.vstack([problem.A.T, -problem.A.T]),
            np.eye(2 * n),
            -np.eye(2 * n),
        ]
    )
    least = np.maximum(np.concatenate([problem.lower, -problem.upper]), 0.0)
    most = np.maximum(np.concatenate([problem.upper, -problem.lower]), 0.0)
    sides = np.concatenate([[rate / problem.top], -problem.b, least, -most])
    assert constraints.shape[1] == sides.size == 1 + m + 4 * n
    kappa = problem.gamma / (1 - problem.gamma)
    try:
        x = quadprog.solve_qp(np.eye(2 * n), np.full(2 * n, -kappa), constraints, sides, meq=1)[0]
    except ValueError:
        return None
    return np.asarray(x[:n] - x[n:])


def kkt_residual(problem: Problem, u: Array, rate: float) -> float:
    """Feasibility of u, and the best multipliers for it by bounded least squares (scipy).

    Stationarity: u + κ s + ν g + Aᵀμ + z = 0 with s_i = sign(u_i), or any of [−1, 1] where u_i = 0;
    μ ≥ 0 for active rows only, z of the right sign for active bounds only.
    """
    n, kappa = u.size, problem.gamma / (1 - problem.gamma)
    slope = problem.gradient / problem.top
    lengths = np.linalg.norm(problem.A, axis=1)
    slack = (problem.b - problem.A @ u) / lengths
    violation = max(
        0.0,
        float(-slack.min()),
        float((u - problem.upper).max()),
        float((problem.lower - u).max()),
        abs(slope @ u - rate / problem.top),
    )
    near = 1e-9
    columns, low, high = [slope], [-np.inf], [np.inf]
    for row, length, gap in zip(problem.A, lengths, slack, strict=True):
        if gap <= near:
            columns.append(row / length)
            low.append(0.0)
            high.append(np.inf)
    for i, one in enumerate(np.eye(n)):
        if problem.upper[i] - u[i] <= near:
            columns.append(one)
            low.append(0.0)
            high.append(np.inf)
        if u[i] - problem.lower[i] <= near:
            columns.append(-one)
            low.append(0.0)
            high.append(np.inf)
        if abs(u[i]) <= near and kappa > 0.0:
            columns.append(one)
            low.append(-kappa)
            high.append(kappa)
    pull = u + kappa * np.where(np.abs(u) <= near, 0.0, np.sign(u))
    found = lsq_linear(np.column_stack(columns), -pull, (low, high), method="bvls", tol=1e-14)
    miss = float(np.abs(found.fun).max()) / max(1.0, kappa, float(np.abs(found.x).max()))
    return max(violation, miss)
