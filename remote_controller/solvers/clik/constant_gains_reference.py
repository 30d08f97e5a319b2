"""Constant gains and what is fed forward for moving targets, in plain numpy.

Marti-Saumell et al., (7), with the σ̇* that is lost between (6) and (7) there, and with limits;
`constant_gains_kernels` and the end of `clik_kernels` are compared with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SINGULAR = 1e-3  # of a pivot of L, which is 1 where a task has all that it needs


def pivots(L: Array) -> Array:
    """What is on the diagonal of L while it is eliminated, (n,); up to the first one that is 0."""
    rest, found = L.copy(), []
    for k in range(len(L)):
        found.append(rest[k, k])
        if rest[k, k] == 0.0:
            break
        rest[k + 1 :] -= np.outer(rest[k + 1 :, k] / rest[k, k], rest[k])
    return np.array(found)


def crossings(start: Array, way: Array, lower: Array, upper: Array) -> tuple[float, float]:
    """Between which s all of lower ≤ start + s·way ≤ upper holds; (∞, −∞)-like where none does."""
    moving = way != 0.0
    one, other = ((limit - start)[moving] / way[moving] for limit in (lower, upper))
    least, most = np.minimum(one, other), np.maximum(one, other)
    return float(max(least, default=-np.inf)), float(min(most, default=np.inf))


def feed_forward(
    B: Array, L: Array, rates: Array, lower: Array, upper: Array, damping: float = 0.0
) -> tuple[Array, float]:
    """What moving targets take of dq, (joints,), and how much of B (L⁻¹ − I) σ̇* is in it.

    L x = σ̇* leaves ė = −L Λ e as for targets that stand. L is J B, without weights.
    """
    plain = B @ rates
    if not rates.any() or damping > 0.0 or np.abs(pivots(L)).min() <= SINGULAR:
        return plain, 1.0
    way = B @ (np.linalg.solve(L, rates) - rates)
    least, most = crossings(plain, way, lower, upper)
    least, most = max(least, 0.0), min(most, 1.0)
    share = 0.0 if least > most else 1.0 if most == 1.0 else least
    return plain + share * way, share


def constant_gains(
    B: Array, wanted: Array, errors: Array, fed: Array, lower: Array, upper: Array
) -> tuple[Array, Array]:
    """Speeds dq = fed + B Λ e within limits, (joints,), and λ, shortened alike where it needs it.

    Where `fed` is outside and no shortened Λ e takes all joints back within, λ is 0.
    """
    way = B @ (wanted * errors)
    least, most = crossings(fed, way, lower, upper)
    stays = bool(((fed < lower) | (fed > upper))[way == 0.0].any())
    share = 0.0 if stays or least > min(1.0, most) else min(1.0, max(most, 0.0))
    return np.clip(fed + share * way, lower, upper), share * wanted
