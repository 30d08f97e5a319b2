"""Motion of joints and contact with compliant planes in plain numpy, as their laws are written.

`motion_kernels` and `contact_kernels` are compared with it. The forces of a contact act on the
velocity that they lead to, so `answered` does not solve for them: it says what they have to be.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CREEP = 1e-3  # m/s: above it friction is Coulomb's


def stopped(q: Array, dq: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Give q at its mechanical stop where it is beyond it, and no velocity further out."""
    slower = np.where(q > upper, np.minimum(dq, 0.0), np.where(q < lower, np.maximum(dq, 0.0), dq))
    return np.clip(q, lower, upper), slower


def accelerated(
    q: Array, dq: Array, ddq: Array, dt: float, lower: Array, upper: Array
) -> tuple[Array, Array]:
    """Constant accelerations for dt: q + dt·dq + dt²/2·ddq and dq + dt·ddq."""
    return stopped(q + dt * dq + 0.5 * dt**2 * ddq, dq + dt * ddq, lower, upper)


def advanced(
    q: Array, dq: Array, ddq: Array, dt: float, lower: Array, upper: Array
) -> tuple[Array, Array]:
    """Semi-implicit Euler: the velocity first, and the position with it."""
    return stopped(q + dt * (dq + dt * ddq), dq + dt * ddq, lower, upper)


def served(
    command: Array, share: float, dt: float, counts: Array, place: Array, shown: Array
) -> tuple[Array, Array, Array]:
    """Servos that do a share of their way: where joints are, what encoders show, and its rate.

    An encoder counts in int16; one with 0 counts per rad shows the place itself.
    """
    there = place + share * (command - place)
    steps = np.where(counts == 0.0, 1.0, counts)
    counted = np.clip(np.rint(there * steps), -(2**15), 2**15 - 1) / steps
    q = np.where(counts == 0.0, there, counted)
    return there, q, (q - shown) / dt


def friction(dq: Array, viscous: Array, coulomb: Array, sliding: float) -> tuple[Array, Array]:
    """B and −B·dq with B = viscous + coulomb/max(|dq|, sliding)."""
    B = viscous + coulomb / np.maximum(np.abs(dq), sliding)
    return B, -B * dq


def touched(place: Array, offset: Array, axes: Array, level: float) -> tuple[Array, float]:
    """A point (3,) of a body at [R p], (3, 4), and its depth below the plane nᵀx = level."""
    point = place[:, :3] @ offset + place[:, 3]
    return point, float(level - axes[0] @ point)


def contact_rows(joints: Array, moved: Array, axes: Array, point: Array) -> Array:
    """Velocities of a point along its axes, (3, n): v + ω × p of the joints that move it."""
    return np.asarray(axes @ (joints[:3] + np.cross(joints[3:].T, point).T) * moved)


def law(depth: float, v: Array, stiffness: float, damping: float, mu: float, h: float) -> Array:
    """Force of one contact, (normal, two tangents), at the velocity v at the end of a step of h.

    f_n = max(0, K δ − max(D, h K) v_n) where δ > 0, and f_t = −μ f_n v_t / max(|v_t|, CREEP).
    """
    if depth <= 0.0:
        return np.zeros(3)
    normal = max(0.0, stiffness * depth - max(damping, h * stiffness) * v[0])
    return np.hstack([normal, -mu * normal * v[1:] / max(np.linalg.norm(v[1:]), CREEP)])


def answered(
    forces: Array, M: Array, J: Array, depths: Array, laws: Array, dq: Array, ddq: Array, h: float
) -> tuple[Array, Array]:
    """The law at the velocity that `forces` lead to, (c, 3), which has to be these forces again.

    M: (n, n); J: (c, 3, n); laws: (c, 3) K, D, μ; ddq: without contact. The second is the
    acceleration with them, ddq + M⁻¹ Σ Jᵀf.
    """
    with_them = ddq + np.linalg.solve(M, np.einsum("cri,cr->i", J, forces))
    velocities = J @ (dq + h * with_them)
    rows = zip(depths, velocities, laws, strict=True)
    return np.array([law(depth, v, K, D, mu, h) for depth, v, (K, D, mu) in rows]), with_them


def sensed(points: Array, forces: Array, origin: Array, rotation: Array) -> Array:
    """Wrench (6,) of forces (c, 3) at points, all in the root, about a sensor, in its axes."""
    moment = np.cross(points - origin, forces).sum(0)
    return np.hstack([rotation.T @ forces.sum(0), rotation.T @ moment])
