"""Random hierarchies with rows of accelerations, (13c); with and without them by quadprog."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import quadprog
from hierarchy_problems import Hierarchy, hierarchy
from support.solvers.one_shot import generalized_projector


@dataclass
class Rows:
    """rows_lower ≤ R q̈ ≤ rows_upper."""

    R: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @property
    def options(self) -> dict:
        return {"rows": self.R, "rows_lower": self.lower, "rows_upper": self.upper}

    @property
    def lengths(self) -> np.ndarray:
        found = np.linalg.norm(self.R, axis=1)
        return np.where(found > 0, found, 1.0)

    def missed(self, qdd: np.ndarray) -> np.ndarray:
        """By how much each is violated, relative to 1 + |bound|, for rows of unit length."""
        value, least, most = self.R @ qdd, self.lower, self.upper
        with np.errstate(invalid="ignore"):
            below = np.where(np.isfinite(least), (least - value) / (self.lengths + abs(least)), 0)
            above = np.where(np.isfinite(most), (value - most) / (self.lengths + abs(most)), 0)
        return np.maximum(np.maximum(below, above), 0.0)


def with_rows(seed: int) -> tuple[Hierarchy, Rows]:
    """Equations, rows held from one side or both, off, of zeros, twice, in all units."""
    it, rng = hierarchy(seed), np.random.default_rng([seed, 1])
    n = it.bias.size
    s = int(rng.integers(1, 2 + n))
    R = rng.normal(size=(s, n))
    for j in range(s):
        kind = rng.integers(12)
        if kind == 0:
            R[j] = np.eye(n)[rng.integers(n)]
        elif kind == 1 and j:
            R[j] = rng.normal() * R[rng.integers(j)]
        elif kind == 2:
            R[j] = it.jacobians[0][0]
        elif kind == 3 and rng.random() < 0.2:
            R[j] = 0
    about = rng.normal(size=n) * rng.choice([0.0, 0.3, 1.0])
    middle, width = R @ about, rng.choice([0.1, 0.5, 2.0], size=s)
    lower, upper = middle - width * rng.random(s), middle + width * rng.random(s)
    kind = rng.integers(6, size=s)
    kind[rng.random(s) < rng.choice([0.0, 0.6])] = 5
    lower[kind == 0] = -np.inf
    upper[kind == 1] = np.inf
    lower[kind == 2], upper[kind == 2] = -np.inf, np.inf
    lower[kind == 3] = upper[kind == 3] = middle[kind == 3]
    units = 10.0 ** rng.integers(-6, 7, size=s)
    return it, Rows(units[:, None] * R, units * lower, units * upper)


def spanned(it: Hierarchy) -> np.ndarray:
    """P of q̈ = P x with all x_i, (n, k n)."""
    sizes, stack = [len(J) for J in it.jacobians], np.vstack(it.jacobians)
    return np.hstack([generalized_projector(np.repeat(row, sizes), stack) for row in it.alpha])


def limits(it: Hierarchy, rows: Rows | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """G, h with G q̈ ≥ h, unit rows, and how many at the beginning are equations."""
    rows = rows or Rows(np.zeros((0, it.bias.size)), np.zeros(0), np.zeros(0))
    ql, qu, tl, tu = it.bounds
    unit, least = rows.R / rows.lengths[:, None], rows.lower / rows.lengths
    most, one = rows.upper / rows.lengths, np.eye(it.bias.size)
    equal = rows.lower == rows.upper
    G = np.vstack([unit[equal], unit[~equal], -unit[~equal], one, -one, it.M, -it.M])
    sides = least[equal], least[~equal], -most[~equal]
    h = np.concatenate([*sides, ql, -qu, tl - it.bias, it.bias - tu])
    given = np.isfinite(h)
    return G[given], h[given], int(equal.sum())


def plain(it: Hierarchy, rows: Rows | None = None) -> np.ndarray | None:
    """q̈ of (13) with all x_i as unknowns, by quadprog; None where it calls it inconsistent.

    The torque is written as M q̈ + n, so that "none" leaves no unknown without a weight.
    """
    n, k, P = it.bias.size, len(it.jacobians), spanned(it)
    H, f = it.w_r * np.eye(k * n), np.zeros(k * n)
    for i, (J, b) in enumerate(zip(it.jacobians, it.targets, strict=True)):
        own = slice(i * n, i * n + n)
        H[own, own] += J.T @ J
        f[own] = J.T @ b
    torque = it.M @ P
    if it.regularise != "none":
        H += it.w_r * torque.T @ torque
        f -= it.w_r * torque.T @ (it.bias * (it.regularise == "torque"))
    G, h, equations = limits(it, rows)
    try:
        some = ((G @ P).T, h, equations) if len(h) else ()
        return P @ quadprog.solve_qp(H, f, *some)[0]
    except ValueError:
        return None


def violation(it: Hierarchy, rows: Rows | None = None) -> float:
    """Least largest violation by any q̈ that the projectors span, equations counted as two rows:
    min s²/2 + ε|x|²/2 with s slackening every row; above rounding: infeasible.
    """
    P = spanned(it)
    G, h, equations = limits(it, rows)
    if not len(h):
        return 0.0
    G, h = np.vstack([G, -G[:equations]]), np.concatenate([h, -h[:equations]])
    slack = np.column_stack([G @ P, np.ones(len(h))])
    H = np.diag([*np.full(P.shape[1], 1e-9), 1.0])
    x = quadprog.solve_qp(H, np.zeros(len(H)), slack.T, h)[0]
    return max(float(x[-1]), 0.0)
