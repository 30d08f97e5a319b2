"""Random hierarchies of tasks, and (13) as it is printed, solved by quadprog."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import quadprog

from hoap3.remote_controller.solvers import generalized_projector

LEAST = -np.inf


@dataclass
class Hierarchy:
    """One problem, by the names of `ghc`."""

    jacobians: list[np.ndarray]
    targets: list[np.ndarray]
    alpha: np.ndarray
    M: np.ndarray
    bias: np.ndarray
    w_r: float
    regularise: str
    bounds: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]

    @property
    def arguments(self) -> tuple:
        return (self.jacobians, self.targets, self.alpha, self.M, self.bias, self.w_r)

    @property
    def options(self) -> dict:
        names = ("qdd_lower", "qdd_upper", "tau_lower", "tau_upper")
        return {"regularise": self.regularise, **dict(zip(names, self.bounds, strict=True))}


def hierarchy(seed: int, n: int | None = None, k: int | None = None) -> Hierarchy:
    """Duplicate and zero rows, ties, cycles; some span all joints; free to tightly bounded."""
    rng = np.random.default_rng(seed)
    n, k = n or int(rng.integers(1, 8)), k or int(rng.integers(1, 6))
    jacobians = [rng.normal(size=(rng.integers(1, 5), n)) for _ in range(k)]
    if rng.random() < 0.7:
        jacobians[-1] = np.eye(n)
    if k > 2 and rng.random() < 0.3:
        jacobians[1] = jacobians[0].copy()
    if rng.random() < 0.2:
        jacobians[0][0] = 0
    alpha = rng.choice([0, 0, 1, 1, 0.5, rng.random()], size=(k, k))
    root = rng.normal(size=(n, n)) / np.sqrt(n)
    tight = rng.choice([0.3, 1, 5, np.inf])
    reach = np.concatenate([np.full(2 * n, tight), np.full(2 * n, 5 * tight)])
    sizes = np.where(reach < np.inf, reach * rng.uniform(0.1, 1, size=4 * n), np.inf)
    absent = rng.random(4 * n) < 0.1
    sizes[absent] = np.inf
    return Hierarchy(
        jacobians,
        [5 * rng.normal(size=len(J)) for J in jacobians],
        alpha,
        root @ root.T + 0.1 * np.eye(n),
        3 * rng.normal(size=n),
        10 ** rng.uniform(-4, -1),
        str(rng.choice(["none", "torque", "gravity_compensated"])),
        (-sizes[:n], sizes[n : 2 * n], -sizes[2 * n : 3 * n], sizes[3 * n :]),
    )


def plain(it: Hierarchy) -> tuple[np.ndarray, np.ndarray] | None:
    """(13) with all x_i as unknowns, by quadprog; None where it calls it inconsistent.

    The torque is written as M q̈ + n, so that "none" leaves no unknown without a weight.
    """
    n, k = len(it.bias), len(it.jacobians)
    sizes, stack = [len(J) for J in it.jacobians], np.vstack(it.jacobians)
    P = np.hstack([generalized_projector(np.repeat(row, sizes), stack) for row in it.alpha])
    H, f = it.w_r * np.eye(k * n), np.zeros(k * n)
    for i, (J, b) in enumerate(zip(it.jacobians, it.targets, strict=True)):
        own = slice(i * n, i * n + n)
        H[own, own] += J.T @ J
        f[own] = J.T @ b
    torque = it.M @ P
    if it.regularise != "none":
        H += it.w_r * torque.T @ torque
        f -= it.w_r * torque.T @ (it.bias * (it.regularise == "torque"))
    rows = np.vstack([P, -P, torque, -torque])
    ql, qu, tl, tu = it.bounds
    least = np.concatenate([ql, -qu, tl - it.bias, it.bias - tu])
    given = np.isfinite(least)
    try:
        some = (rows[given].T, least[given]) if given.any() else ()
        x = quadprog.solve_qp(H, f, *some)[0]
    except ValueError:
        return None
    return P @ x, torque @ x + it.bias


def violation(it: Hierarchy) -> float:
    """Least largest violation of the bounds by any q̈ that the projectors span, by a program of its
    own: min s²/2 + ε|x|²/2 with s slackening every bound; above rounding: infeasible.
    """
    n, k = len(it.bias), len(it.jacobians)
    sizes, stack = [len(J) for J in it.jacobians], np.vstack(it.jacobians)
    P = np.hstack([generalized_projector(np.repeat(row, sizes), stack) for row in it.alpha])
    ql, qu, tl, tu = it.bounds
    rows = np.vstack([P, -P, it.M @ P, -it.M @ P])
    least = np.concatenate([ql, -qu, tl - it.bias, it.bias - tu])
    given = np.isfinite(least)
    if not given.any():
        return 0.0
    slack = np.column_stack([rows[given], np.ones(given.sum())])
    H = np.diag([*np.full(k * n, 1e-9), 1.0])
    x = quadprog.solve_qp(H, np.zeros(k * n + 1), slack.T, least[given])[0]
    return max(float(x[-1]), 0.0)
