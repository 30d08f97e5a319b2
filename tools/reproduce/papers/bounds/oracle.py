"""Closed forms of the paper's sets, and oracles of its motions and regions.

Sets have closed forms; regions come from Algorithms 1 to 3 as
printed; motions of Fig. 4 from (31) and (32) within bounds that are found without formulas.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.limits.viability_bounds_oracle import bounds, naive_bounds
from hoap3.tools.reproduce.papers.bounds.joint import Joint

Array = NDArray[np.float64]

VIABLE, VIABLE_AND_REACHABLE = 31.0 / 36.0, 13.0 / 18.0
"""Shares of F in Fig. 1, by 1 − V²/(12·A·Q): one corner a side, or two."""

CURVE_MEETS_SPEED = 1.0 / 6.0
"""Q − V²/(2A) in Fig. 1 [rad]."""

REGIONS = ("unreachable", "not viable", "position", "velocity", "ddq_max", "viability")
"""Those of Fig. 3, by number."""


def turning_share(joint: Joint) -> float:
    """Share of the viable states with dq > 0 that must turn round within δt, exactly.

    D < vδt/2 and v² ≤ 2AD, hence v < Aδt: ∫(vδt/2 − v²/(2A))dv from 0 to Aδt is A²δt³/12; (11) has
    Aδt ≤ V. All of them are 2QV − V³/(6A).
    """
    A, V = joint.acceleration, joint.speed
    return A * A * joint.period_s**3 / 12.0 / (2.0 * joint.end * V - V**3 / (6.0 * A))


def region_shares(joint: Joint, side: int) -> dict[str, float]:
    """Shares of F in Fig. 3: the least of what Algorithms 1 to 3 compare, as they are printed."""
    q, v = joint.end * np.linspace(-1, 1, side), joint.speed * np.linspace(-1, 1, side)[:, None]
    T, A, D = joint.period_s, joint.acceleration, joint.end - q + 0.0 * v
    with np.errstate(divide="ignore", invalid="ignore"):
        a1, a2, a3 = -v / T + 0.0 * D, -(v**2) / (2.0 * D), 2.0 * (D - T * v) / T**2
        position = np.where((v >= 0.0) & (a3 <= a1), np.fmin(a1, a2), a3)
        b, c = T * (2.0 * v + A * T), v**2 - 2.0 * A * (D - T * v)
        root = np.sqrt(b * b - 4.0 * T**2 * c)
    viability = np.fmax(a1, (-b + root) / (2.0 * T**2))
    velocity, most = (joint.speed - v) / T + 0.0 * D, np.full_like(D, A)
    viable = np.where(v > 0.0, v**2 <= 2.0 * A * D, v**2 <= 2.0 * A * (joint.end + q))
    order = np.argmin([most, velocity, viability, position], axis=0)  # the first of equal ones
    region = np.array([4, 3, 5, 2])[order]
    region[~viable] = 1
    region[~viable[::-1]] = 0
    return {name: float((region == number).mean()) for number, name in enumerate(REGIONS)}


def motion(
    joint: Joint, periods: float, target: float, kp: float, seconds: float, *, naive: bool
) -> tuple[Array, Array, Array]:
    """q, dq and ddq of Fig. 4 from rest at 0, by tick: (31), (32) with kd = 2√kp, and (1)."""
    ticks, T, q, v = round(seconds / joint.period_s), joint.period_s, 0.0, 0.0
    found = np.zeros((3, ticks))
    limits = [np.array([x]) for x in (joint.speed, joint.acceleration, joint.acceleration)]
    for k in range(ticks):
        rooms = np.array([joint.end - q]), np.array([joint.end + q]), np.array([v])
        given = limits[:2] if naive else limits
        low, high = (naive_bounds if naive else bounds)(*rooms, *given, periods * T)  # type: ignore
        wanted = kp * (target - q) - 2.0 * math.sqrt(kp) * v
        a = float(np.clip(min(max(wanted, low[0]), high[0]), -joint.acceleration, limits[1][0]))
        found[:, k] = q, v, a
        q, v = q + T * v + 0.5 * T**2 * a, v + T * a
    return found[0], found[1], found[2]
