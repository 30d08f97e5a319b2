"""Problem (3) in weighted velocities y = W u, its rows at length 1, as its optimum is judged.

QP12's Φ is divided by 1 − γ, κ|y|₁ + ½|y|² with κ = γ/(1 − γ), and |y|_p by what is added to it to
make u unique. Then y, the sides of rows and their multipliers are of the size of speeds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from support.oracles.stable_qp_arrays.problem import Cycle

Array = NDArray[np.float64]

TINY = 1e-200
UNIQUE = 1e-6  # weight of ½|u|² beside ℓ1, ℓ∞ and least squares
MOST_GAMMA = 1.0 / (1.0 + UNIQUE)


@dataclass(frozen=True)
class Objective:
    """Which Φ it is.

    Attributes:
        kind: `norm`, κ|y|₁ + ½|y|²; `largest`, κ·max|y| + ½|y|²; or `squares`, ½|M u − y|².
        exponent: p where Φ = |W u|_p, else None.
        weights: W, (n,).
        alone: whether |u|_p is minimised with nothing to keep but V's rate.
    """

    kind: str
    exponent: float | None
    weights: Array
    alone: bool

    @classmethod
    def of(
        cls, settings: Mapping[str, Any], joints: tuple[str, ...], *, constrained: bool
    ) -> Objective:
        """The Φ of a config's objective.

        Args:
            settings: of the objective.
            joints: their names.
            constrained: whether there is anything to keep but V's rate.

        Raises:
            ValueError: an exponent or weights that mean nothing.
        """
        weights, given = np.ones(len(joints)), settings.get("weights") or {}
        for name, weight in dict(given).items():
            weights[joints.index(name)] = float(weight)
        if not (np.isfinite(weights) & (weights > 0.0)).all():
            raise ValueError(f"weights are {given!r:.60}")
        p = settings.get("p")
        exponent = None if p is None else float(p)
        if settings["kind"] == "lp" and not (exponent is not None and exponent > 0.0):
            raise ValueError(f"the exponent p is {p!r:.40}")
        kinds = {"qp12": "norm", "least_squares": "squares"}
        kind = kinds.get(settings["kind"], "largest" if exponent == np.inf else "norm")
        return cls(kind, exponent, weights, exponent is not None and not constrained)

    def kappa(self, gamma: float) -> float:
        """Weight of |y|₁, or of max|y|."""
        if self.kind == "largest":
            return 1.0 / UNIQUE
        if self.kind == "squares":
            return 0.0
        gamma = min({1.0: MOST_GAMMA, 2.0: 0.0}.get(self.exponent or 0.0, gamma), MOST_GAMMA)
        return gamma / (1.0 - gamma)


@dataclass(frozen=True)
class Scaled:
    """One cycle's problem, and what was answered, in y.

    Attributes:
        y: W u of the answer, (n,), exact to `doubt`, (n,).
        lower, upper: of y, (n,).
        kappa: κ.
        top: what ∇V is divided by, max|W⁻¹∇V|.
        slope: s = W⁻¹∇V/top, (n,), exact to `slope_doubt`, (n,).
        rows, sides: of the inequalities, (s, n), (s,), each of length 1; `asked` as of the cycle.
        equations, values: (k, n), (k,), likewise.
        H, f: of ½ yᵀHy + fᵀy, the smooth part of Φ.
        fall, wanted: −s·y, and what of it makes ρ = 1.
        scale: what residuals are relative to: max|y|, or a thousandth of the largest bound.
    """

    y: Array
    doubt: Array
    lower: Array
    upper: Array
    kappa: float
    top: float
    slope: Array
    slope_doubt: Array
    rows: Array
    sides: Array
    asked: NDArray[np.bool_]
    equations: Array
    values: Array
    H: Array
    f: Array
    wanted: float
    scale: float

    @property
    def fall(self) -> float:
        """−s·y."""
        return -float(self.slope @ self.y)

    @property
    def forced(self) -> float:
        """Fastest speed that a side asks for; 0 or less where y = 0 keeps them all."""
        least = np.concatenate([self.lower, self.values, [-np.inf]]).max()
        most = np.concatenate([self.upper, self.sides, self.values, [np.inf]]).min()
        return float(max(least, -most))

    def price(self, max_speed_ratio: float, kind: str) -> float:
        """What a faster fall of V is worth, where ρ is damped.

        It is the cost of moving one joint a little faster, at `max_speed_ratio` times the speed
        that it alone would need for what is wanted.
        """
        near = self.kappa if kind == "norm" else 0.0
        worth = max_speed_ratio * (near + abs(self.wanted) + max(self.forced, 0.0))
        if kind == "squares":
            worth = worth * float(self.H.diagonal().max()) + float(np.abs(self.f).max())
        else:
            worth += self.kappa
        return worth if self.wanted >= 0.0 else -worth


class Stacked:
    """The problems of many cycles, without their rows.

    Args:
        chunk: the cycles.
        objective: their Φ.
        u, doubt: the answers, and how exactly they are known, both (N, n).
        asked: falls of V by the joints that make ρ = 1, (N,).

    Attributes:
        y, doubt, lower, upper, slope, slope_doubt: (N, n), as of `Scaled`.
        kappa, top, wanted, scale: (N,), likewise.
    """

    def __init__(
        self, chunk: Sequence[Cycle], objective: Objective, u: Array, doubt: Array, asked: Array
    ) -> None:
        self._chunk, self._objective, W = chunk, objective, objective.weights
        gradient, inexact, lower, upper = (
            np.array([getattr(cycle, name) for cycle in chunk])
            for name in ("gradient", "gradient_doubt", "lower", "upper")
        )
        self.y, self.doubt, self.lower, self.upper = W * u, W * doubt, W * lower, W * upper
        self.kappa = np.array([objective.kappa(cycle.gamma) for cycle in chunk])
        self.top = np.abs(gradient / W).max(1)
        size = np.where(self.top > 0.0, self.top, np.inf)[:, None]
        self.slope, self.slope_doubt = gradient / W / size, inexact / W / size
        self.wanted = asked / size[:, 0]
        limits = np.abs(np.hstack([self.lower, self.upper]))
        widest = np.where(np.isfinite(limits), limits, 0.0).max(1)
        self.scale = np.maximum(np.maximum(np.abs(self.y).max(1), 1e-3 * widest), TINY)

    def __getitem__(self, i: int) -> Scaled:
        """One of them, with its rows."""
        cycle, W = self._chunk[i], self._objective.weights
        A, b, keep = _unit(cycle.A / W, cycle.b)
        C, c, _ = _unit(cycle.C / W, cycle.c)
        H, f = np.eye(W.size), np.zeros(W.size)
        if self._objective.kind == "squares":
            H = cycle.M.T @ cycle.M + UNIQUE * H
            f = -cycle.y @ cycle.M
        return Scaled(
            self.y[i], self.doubt[i], self.lower[i], self.upper[i], float(self.kappa[i]),
            float(self.top[i]), self.slope[i], self.slope_doubt[i], A, b, cycle.asked[keep], C, c,
            H, f, float(self.wanted[i]), float(self.scale[i]),
        )  # fmt: skip


def _unit(A: Array, b: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Rows and sides at length 1; rows of zeros that ask for nothing are left out."""
    length = np.linalg.norm(A, axis=1)
    keep = (length > 0.0) | (b < 0.0)
    size = np.where(length > 0.0, length, 1.0)[keep]
    return A[keep] / size[:, None], b[keep] / size, keep
