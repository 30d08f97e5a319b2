"""Costs Φ of `stable_qp` as programs; all are scaled so that ½|W u|² has the factor 1.

QP12's γ|W u|₁ + ½(1 − γ)|W u|² is divided by 1 − γ: κ|y|₁ + ½|y|² with y = W u, κ = γ/(1 − γ).
ℓ1, ℓ∞ and least squares have ½·10⁻⁶|y|² added, which makes u unique.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hoap3.remote_controller.problems.statement import Array, Program, Rows

UNIQUE = 1e-6  # weight of ½|u|² beside ℓ1, ℓ∞ and least squares
MOST_GAMMA = 1.0 / (1.0 + UNIQUE)
TIED = 1e-9  # of max|y|: joints that are as fast as this are among the fastest
TINY = 1e-200


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

    def program(
        self, u: Array, gamma: float, rows: Rows, cost: Array, squares: tuple[Array, Array]
    ) -> Program:
        """Min Φ(u) + cost·u within rows, with the answer u as the proposal; its error is 0.

        Args:
            u: (n,) [rad/s].
            gamma: of this cycle.
            rows: of u.
            cost: (n,).
            squares: M and y of least squares.
        """
        n, W, kappa, zero = u.size, self.weights, self.kappa(gamma), np.zeros(u.size)
        eye, none = np.eye(n), np.zeros(n)
        if self.kind == "squares":
            R = np.vstack([squares[0], np.sqrt(UNIQUE) * eye])
            r = np.concatenate([squares[1], none])
            return Program(R, r, cost, zero, rows, eye, none, zero, u)
        if self.kind == "norm":
            return Program(np.diag(W), none, cost, kappa * W, rows, eye, none, zero, u)
        largest = float(np.abs(W * u).max())  # z = (u, t), |W u| ≤ t
        sides = np.hstack([np.vstack([np.diag(W), -np.diag(W)]), -np.ones((2 * n, 1))])
        near = Rows.of(sides, -np.inf, 0.0, error=TIED * largest)
        wide = replace(rows, A=np.hstack([rows.A, np.zeros((len(rows.A), 1))]))
        return Program(
            np.hstack([np.diag(W), np.zeros((n, 1))]),
            none,
            np.append(cost, kappa),
            np.zeros(n + 1),
            Rows.stacked([wide, near]),
            np.hstack([eye, np.zeros((n, 1))]),
            none,
            zero,
            np.append(u, largest),
        )

    def price(
        self, gamma: float, wanted: float, forced: float, ratio: float, squares: tuple[Array, Array]
    ) -> float:
        """What a faster fall of V is worth where ρ is damped, in units of the scaled Φ.

        It is the cost of moving one joint a little faster, at `max_speed_ratio` times the speed
        that it alone would need for what is wanted.

        Args:
            gamma: of this cycle.
            wanted: fall of V for ρ = 1, by the largest entry of W⁻¹∇V [rad/s].
            forced: the fastest speed that a limit asks for.
            ratio: `max_speed_ratio`.
            squares: M and y of least squares.
        """
        kappa = self.kappa(gamma)
        worth = ratio * ((kappa if self.kind == "norm" else 0.0) + abs(wanted) + max(forced, 0.0))
        if self.kind == "squares":
            M, y = squares
            H = M.T @ M + UNIQUE * np.eye(M.shape[1])
            worth = worth * float(H.diagonal().max()) + float(np.abs(y @ M).max())
        else:
            worth += kappa
        return worth if wanted >= 0.0 else -worth

    def scale(self, u: Array, lower: Array, upper: Array, gamma: float) -> float:
        """What residuals are relative to: max|y|, a thousandth of the largest bound, or 10⁻⁶ κ."""
        limits = np.abs(np.concatenate([self.weights * lower, self.weights * upper]))
        widest = float(np.where(np.isfinite(limits), limits, 0.0).max())
        speeds = float(np.abs(self.weights * u).max()), 1e-3 * widest
        return max(*speeds, UNIQUE * self.kappa(gamma), TINY)

    def holder_gap(self, gradient: Array, u: Array) -> float:
        """1 − |s·y|/(|s|_q·|y|_p), s = W⁻¹∇V; 0 where nothing moves.

        Where V's rate alone is asked for, Hölder's inequality says |s·y| ≤ |s|_q·|y|_p with
        1/p + 1/q = 1, q = ∞ for p ≤ 1 (Gonçalves et al., IEEE T-RO 2020, Example 2).
        """
        if not u.any():
            return 0.0
        p = float(self.exponent or 0.0)
        q = np.inf if p <= 1.0 else 1.0 if np.isinf(p) else p / (p - 1.0)
        slope, y = gradient / self.weights, self.weights * u
        span, top = np.abs(y).max(), np.abs(slope).max()
        lengths = np.linalg.norm(slope / top, q) * np.linalg.norm(y / span, p)
        return float(1.0 - abs(slope @ y) / (top * span) / lengths)
