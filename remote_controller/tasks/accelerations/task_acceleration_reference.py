"""What tasks ask of accelerations, and what becomes of V, in plain numpy: Del Prete 2018, (34).

`task_acceleration_kernels` is compared with it. A task's error e moves by −ν, its motion against
its target, and ν by J·ddq + ν̇₀; ν̇₀ is J̇·dq less the target's own acceleration.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import logm

Array = NDArray[np.float64]

UNSURE = 1e-2  # of an acceleration, and of 1 m/s²


def wanted(e: Array, nu: Array, rate: Array, kp: float, kd: float) -> Array:
    """J·ddq of (34): kp·e − kd·ν − ν̇₀."""
    return np.asarray(kp * e - kd * nu - rate)


def position(target: Array, origin: Array, twist: Array, drift: Array) -> tuple[Array, ...]:
    """e, ν and ν̇₀ of a place, from x_d, v_d and a_d, the rows of `target`."""
    return target[0] - origin, twist - target[1], drift - target[2]


def orientation(rotation: Array, goal: Array) -> Array:
    """φ in the root's axes: [φ]× = log(R_d Rᵀ)."""
    phi: Array = np.real(logm(goal @ rotation.T)).astype(np.float64)
    return np.array([phi[2, 1], phi[0, 2], phi[1, 0]])


def to_posture(
    q: Array, dq: Array, goal: Array, kp: float, kd: float, bounds: tuple[Array, Array]
) -> Array:
    """(31) and (32): the q̈ within its bounds nearest to kp·(q_r − q) − kd·q̇, joint by joint."""
    return np.clip(kp * (goal - q) - kd * dq, *bounds)


def torque_rows(J: Array, M: Array) -> Array:
    """J M⁻¹, (m, n): how torques move tasks."""
    return np.asarray(np.linalg.solve(M, J.T).T, np.float64)


def in_root(
    place: Array, velocity: Array, later: Array, T: float, origin: Array, axes: Array
) -> Array:
    """x_d, v_d and a_d, (3, 3), of a target in a frame at rest; `later`: its velocity after T."""
    return np.array([origin + axes @ place, axes @ velocity, axes @ (later - velocity) / T])


def loaded(
    M: Array, h: Array, J: Array, w: Array, damping: Array, dq: Array, T: float
) -> tuple[Array, Array]:
    """M and h of M ddq + h + d·(dq + T·ddq) = τ + Jᵀw, w what is felt."""
    return M + T * np.diag(damping), h + damping * dq - J.T @ w


def predicted(
    e: Array, nu: Array, rate: Array, slope: Array, gained: Array, T: float
) -> tuple[float, float, float]:
    """V = ½|e|², V̇ half a period on and the most that V may rise by per second.

    slope: V̇ = slope·ν; gained: J·ddq. The most is V̇ + ½|ė|²T with |ė| ≤ 2|ν|, and what is unsure.
    """
    change = rate + gained
    moving = nu + 0.5 * T * change
    unsure = UNSURE * T * np.abs(slope) @ (np.abs(change) + 1.0)
    fall = float(slope @ moving)
    return float(0.5 * e @ e), fall, float(fall + 2.0 * T * moving @ moving + unsure)
