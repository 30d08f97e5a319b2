"""Stationary tasks, and tasks that make no progress, in plain numpy."""

from __future__ import annotations

from typing import Any

import numpy as np

from hoap3.protocol.messages import FloatArray


def progress(
    error: FloatArray,
    jacobian: FloatArray,
    velocity: FloatArray,
    decided: FloatArray,
    limits: tuple[FloatArray, FloatArray],
    steps: tuple[FloatArray, FloatArray],
) -> tuple[bool, bool, Any]:
    """Find whether one task is stationary, or makes no progress, and which joints hold it.

    Args:
        error, jacobian: e (m,) of V = ½|e|², and J = ∂e/∂q (m, n).
        velocity: q̇ (n,).
        decided: what `limits` bound, (n,): the velocity or the acceleration.
        limits: lower and upper, (n,) each.
        steps: velocities that lead to the ends of the range in one period, (n,) each.

    Returns:
        Whether |Jᵀe| ≤ 1e-6·|J|·|e| with the Frobenius norm; whether, where it is not, V falls by
        less than 0.1 % a second; and of such a task the joints (n,) at a limit that −Jᵀe points
        beyond.
    """
    (lower, upper), (least, most) = limits, steps
    slope = jacobian.T @ error
    negligible = 1e-6 * np.linalg.norm(jacobian) * np.linalg.norm(error)
    stationary = bool(error.any() and np.linalg.norm(slope) <= negligible)
    moves = np.clip(velocity, np.minimum(least, 0.0), np.maximum(most, 0.0))
    stuck = bool(error.any() and not stationary and -slope @ moves <= 1e-3 * (error @ error) / 2.0)
    room_up = np.minimum(upper - decided, most - velocity)
    room_down = np.minimum(decided - lower, velocity - least)
    ahead = np.where(slope < 0.0, room_up, room_down)
    pulled = np.abs(slope) > negligible / np.sqrt(len(slope))
    return stationary, stuck, pulled & (ahead <= 1e-6) if stuck else np.zeros(len(slope), bool)
