"""Whether accelerations are the optimum of a quadratic program, by its KKT conditions.

Multipliers come from non-negative least squares on the rows that are at their bounds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import ROUNDING
from hoap3.tools.verify.claims import RELATIVE
from hoap3.tools.verify.controllers.acceleration.hierarchy import Cycles

Array = NDArray[np.float64]

MOST_STEPS = 10_000  # of non-negative least squares; some ten are usual
TINY = 1e-9  # rad/s²: accelerations below it count as that much


class Values(NamedTuple):
    """Numbers within bounds, (N, n) each, and how exactly they are known."""

    found: Array
    exact: Array
    lower: Array
    upper: Array

    @property
    def active(self) -> NDArray[np.bool_]:
        """Which upper and lower bounds are reached, to rounding, (N, 2, n)."""
        near = self.exact + RELATIVE * (1.0 + np.abs(self.found))
        return np.stack([self.upper - self.found <= near, self.found - self.lower <= near], axis=1)

    def beyond(self, scale: Array | float) -> Array:
        """The most that a bound is exceeded by, relative to a scale, (N,)."""
        out = np.maximum(self.found - self.upper, self.lower - self.found)
        return np.asarray((np.maximum(0.0, out) / scale).max(1))


def motion_and_torques(cycles: Cycles, torque_max: Array) -> tuple[Values, Values]:
    """q̈ and τ within their bounds."""
    most = np.broadcast_to(torque_max, cycles.tau.shape)
    return (
        Values(cycles.ddq, cycles.ddq_exact, cycles.lower, cycles.upper),
        Values(cycles.tau, cycles.tau_exact, -most, most),
    )


def optimum_of(
    H: Array, f: Array, f_exact: Array, cycles: Cycles, torque_max: Array
) -> tuple[Array, Array]:
    """How far q̈ is from min ½ q̈ᵀH q̈ + fᵀq̈ within all bounds, (N,), and how exactly.

    It is the largest of what the gradient would move a joint by, g_i/H_ii, and by what a bound is
    exceeded, relative to the largest acceleration or what f asks for; and the latter of a torque,
    relative to the greatest one.
    """
    ddq, tau = motion_and_torques(cycles, torque_max)
    gradient = (H @ ddq.found[..., None])[..., 0] + f
    stiff = np.diagonal(H, axis1=1, axis2=2)
    span = np.maximum(TINY, np.maximum(np.abs(ddq.found), np.abs(f) / stiff).max(1))
    scales = np.eye(H.shape[1]) / stiff[:, None, :]
    left = away(gradient / stiff, scales, cycles.mass, np.hstack([ddq.active, tau.active]))
    residual = np.maximum(np.abs(left).max(1), ddq.beyond(1.0)) / span
    doubt = ddq.exact + ROUNDING * np.abs(ddq.found)
    off = f_exact + ROUNDING * np.abs(f) + (np.abs(H) @ doubt[..., None])[..., 0]
    exact = (off / stiff + ddq.exact).max(1) / span + (tau.exact / torque_max).max(1)
    return np.maximum(residual, tau.beyond(torque_max)), exact


def away(pull: Array, rows: Array, mass: Array, active: NDArray[np.bool_]) -> Array:
    """What multipliers ≥ 0 of the active bounds leave of each pull, (N, n).

    Args:
        pull: S·g, (N, n), of a gradient g.
        rows: S, (N, n, n), that turns a gradient into it.
        mass: M, (N, n, n); τ = M·q̈ + h.
        active: (N, 4, n), by `Values.active` of q̈ and τ.
    """
    left = pull.copy()
    for i in np.flatnonzero(active.any((1, 2))):
        up, down, over, under = active[i]
        S, M = rows[i], mass[i]
        normals = np.vstack([np.eye(len(S))[up], -np.eye(len(S))[down], M[over], -M[under]])
        columns = S @ normals.T
        length = np.linalg.norm(columns, axis=0)
        columns = columns / np.where(length > 0.0, length, 1.0)
        left[i] += columns @ nnls(columns, -left[i], maxiter=MOST_STEPS)[0]
    return left
