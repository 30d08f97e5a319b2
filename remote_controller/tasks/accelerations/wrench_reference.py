"""A wrench kept in place of a pose, in plain numpy: Liu, Tan and Padois (2015), (3), corrected.

What `wrench_kernels` computes, in its simplest form, without numba; tests compare the two.
"""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray


def wrench_about(
    rotation: FloatArray, wrench: FloatArray, sensor: FloatArray, origin: FloatArray
) -> FloatArray:
    """f: a sensor's wrench (6,), in its own axes and about s, in the root's and about p."""
    force, torque = rotation @ wrench[:3], rotation @ wrench[3:]
    return np.concatenate([force, torque + np.cross(sensor - origin, force)])


def in_root_axes(
    rotation: FloatArray, jacobian: FloatArray, twist: FloatArray, drift: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """J, ν and J̇·dq of a frame in its own axes, seen in the root's: ν = blkdiag(R, R)·ν′."""
    both = np.kron(np.eye(2), rotation)
    carried = np.concatenate([np.cross(twist[3:], twist[:3]), np.zeros(3)])  # ω′ × v′
    return both @ jacobian, both @ twist, both @ (drift + carried)


def aimed(wanted: FloatArray, measured: FloatArray, kp: float, integral: FloatArray) -> FloatArray:
    """What S·f shall be, w = w_d + kp·(w_d − S·f) + ki·∫(w_d − S·f), (k,); the last is given."""
    return wanted + kp * (wanted - measured) + integral


def inverse_task_inertia(
    mass: FloatArray, jacobian: FloatArray, S: FloatArray, P: FloatArray
) -> FloatArray:
    """Λ_S⁻¹ (k, k): (3)'s S J M⁻¹ Jᵀ Sᵀ, less what is lost where P (h, m) do not move."""
    B = jacobian @ np.linalg.solve(mass, jacobian.T)
    return S @ B @ S.T - S @ B @ P.T @ np.linalg.pinv(P @ B @ P.T, rcond=1e-11) @ P @ B @ S.T


def wanted_acceleration(
    S: FloatArray,
    inverse_inertia: FloatArray,
    missing: FloatArray,
    kd: float,
    motion: FloatArray,
    drift: FloatArray,
    wanted: FloatArray,
) -> FloatArray:
    """What J·ddq shall be, (m,): along S, a_S − S·J̇·dq; across, what was `wanted` before.

    a_S = Λ_S⁻¹·(S·f − w) − kd·S·ν is (3) with the measured f in the equation of motion, so that the
    task's frame rests where S·f = w; `missing` is S·f − w, (k,).
    """
    a_S = inverse_inertia @ missing - kd * (S @ motion)
    across = np.eye(S.shape[1]) - S.T @ S
    return across @ wanted + S.T @ (a_S - S @ drift)
