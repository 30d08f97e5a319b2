"""Whether an answer to (3) is the optimum, by multipliers from non-negative least squares.

With r = y − ∂φ/∂y − rowsᵀ·multipliers, φ the smooth part of Φ, y is optimal where multipliers of
rows that do not hold it are 0, the others not negative, and

    y_i = the point within its bounds nearest to sign(r_i)·max(0, |r_i| − κ)            `norm`
    y_i = the point within its bounds and ±max|y| nearest to r_i, where what max|y| cuts off adds
          up to κ                                                                       `largest`
    y_i = the point within its bounds nearest to r_i                                    `squares`

V's rate is the equation s·y = −fall, of which the multiplier may have either sign.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from support.oracles.stable_qp_arrays.scaled import Scaled

Array = NDArray[np.float64]

NEAR = 1e-8  # of the scale: how near its side a row or a bound may hold y
NEARER = (1e-9, 1e-10, 1e-11, 1e-12)
TIED = 1e-9  # of max|y|: joints as fast as that by this much are among the fastest
FREE, FIXED, FALLING = "free", "fixed", "falling"
"""What the multiplier of V's rate may be: anything, a price, or ≥ 0 where V̇ ≤ 0 is all."""


def residual(p: Scaled, kind: str, enough: float, rate: str = FREE, price: float = 0.0) -> float:
    """How far an answer is from optimal, relative, for the best multipliers that there are.

    Args:
        p: the problem with its answer.
        kind: of objective.
        enough: a residual that counts as optimal: what is so near its side may hold y.
        rate: what the multiplier of V's rate may be.
        price: that it is, where it is fixed.
    """
    found = np.inf
    for share in (max(NEAR, 2.0 * min(enough, 1.0)), *NEARER):
        # what is near a side need not be held by it: any multipliers prove what they prove
        found = min(found, _residual(p, kind, share, rate, price))
        if found <= enough:
            break
    return found


def _residual(p: Scaled, kind: str, share: float, rate: str, price: float) -> float:
    """The same, where what is within a share of the scale of its side may be held."""
    pull = p.y - (p.H @ p.y + p.f) - (price * p.slope if rate == FIXED else 0.0)
    slack = p.sides - p.rows @ p.y
    near = share * p.scale
    holds = slack <= near + np.abs(p.rows) @ p.doubt
    parts = [p.rows[holds], p.equations, -p.equations]
    if rate == FREE:
        parts += [p.slope[None], -p.slope[None]]
    elif rate == FALLING and p.fall - p.wanted <= near:
        parts += [p.slope[None]]
    B = np.vstack(parts)
    tied = np.zeros(p.y.size, bool)
    if kind == "largest":
        tied = np.abs(p.y) >= (1.0 - TIED) * np.abs(p.y).max() - 2.0 * p.doubt.max()
    z = _multipliers(B, pull, *_range(p, kind, near + p.doubt), p, tied)
    r = pull - z @ B
    away = float(np.abs(p.y - _nearest(r, p, kind)).max())
    if kind == "largest":
        away = max(away, _uncut(r, p, tied, near + p.doubt))
    largest = max(float(np.abs(z).max(initial=0.0)), abs(price), p.kappa)
    inside = np.minimum(z[: holds.sum()], np.maximum(slack[holds], 0.0)).max(initial=0.0)
    broken = np.abs(p.equations @ p.y - p.values).max(initial=0.0)
    return float(max(max(inside, broken) / p.scale, away / max(p.scale, 1e-6 * largest)))


def _range(p: Scaled, kind: str, near: Array) -> tuple[Array, Array]:
    """Where r has to be, (n,) and (n,): ∓inf is no side."""
    y = p.y
    kappa = p.kappa if kind == "norm" else 0.0
    still = (np.abs(y) <= near) & (kappa > 0.0)
    least = np.where(still, np.minimum(y, 0.0) - kappa, y + kappa * np.sign(y))
    most = np.where(still, np.maximum(y, 0.0) + kappa, y + kappa * np.sign(y))
    least = np.where(y - p.lower <= near, -np.inf, least)
    return least, np.where(p.upper - y <= near, np.inf, most)


def _multipliers(
    B: Array, pull: Array, least: Array, most: Array, p: Scaled, tied: NDArray[np.bool_]
) -> Array:
    """Multipliers z ≥ 0 for which r = pull − Bᵀz is as near to its range as can be, (rows of B,).

    Further unknowns ≥ 0 say how far r is from one side of its range, how far from the other, the
    two of which add up to its width, and what max|y| cuts off of the fastest, which adds up to κ.
    """
    one = np.eye(pull.size)
    below, above = np.isfinite(least), np.isfinite(most)
    exact = below & above & (least == most)
    rising, falling = below & ~exact, above & ~below
    both = rising & above
    cuts = one[:, tied] * np.sign(p.y[tied])
    pairs = one[both][:, rising]
    m, widths = len(B), (most - least)[both]
    used = below | above
    first = np.hstack([B.T, one[:, rising], -one[:, falling], cuts])[used]
    E = np.zeros((len(first) + len(pairs) + (cuts.size > 0), first.shape[1] + len(pairs)))
    E[: len(first), : first.shape[1]] = first
    second = E[len(first) : len(first) + len(pairs)]
    second[:, m : m + pairs.shape[1]] = pairs
    second[:, first.shape[1] :] = np.eye(len(pairs))
    right = [(pull - np.where(below, least, most))[used], widths]
    if cuts.size:
        E[-1, first.shape[1] - cuts.shape[1] : first.shape[1]] = 1.0
        right.append(np.array([p.kappa]))
    if not E.size:  # scipy's nnls must not be asked
        return np.zeros(m)
    size = np.linalg.norm(E, axis=0)
    size[size == 0.0] = 1.0
    z, _ = nnls(E / size, np.concatenate(right), maxiter=100 * E.shape[1])
    return np.asarray((z / size)[:m])


def _nearest(r: Array, p: Scaled, kind: str) -> Array:
    """The y that r stands for, (n,)."""
    if kind == "norm":
        r = np.sign(r) * np.maximum(np.abs(r) - p.kappa, 0.0)
    most = np.abs(p.y).max() if kind == "largest" else np.inf
    return np.clip(r, np.maximum(p.lower, -most), np.minimum(p.upper, most))


def _uncut(r: Array, p: Scaled, tied: NDArray[np.bool_], near: Array) -> float:
    """By how much what max|y| cuts off of r does not add up to κ, a joint."""
    most = float(np.abs(p.y).max())
    cut = np.maximum(np.abs(r) - most, 0.0)
    side = np.where(r > 0.0, p.upper, -p.lower)
    free = side - near > (1.0 + TIED) * most  # no bound cuts it as well
    short = p.kappa - float(cut[tied].sum()) if most > 0.0 else 0.0
    return max(short, float(cut[free].sum()) - p.kappa) / max(int(tied.sum()), 1)


def holder_gap(slope: Array, u: Array, p: float) -> float:
    """1 − |s·u|/(|s|_q·|u|_p), 0 where nothing moves, or where no shorter u gives V's rate.

    Where that rate alone is asked for, Hölder's inequality says |s·u| ≤ |s|_q·|u|_p with
    1/p + 1/q = 1, q = ∞ for p ≤ 1 (Gonçalves et al., IEEE T-RO 2020, Example 2).

    Args:
        slope, u: (n,).
        p: > 0, may be inf.
    """
    if not u.any():
        return 0.0
    q = np.inf if p <= 1.0 else 1.0 if np.isinf(p) else p / (p - 1.0)
    span, top = np.abs(u).max(), np.abs(slope).max()
    lengths = np.linalg.norm(slope / top, q) * np.linalg.norm(u / span, p)
    return float(1.0 - abs(slope @ u) / (top * span) / lengths)
