"""Task-space inverse dynamics in plain numpy: what the kernels here are checked against.

Del Prete, IEEE RA-L 2018, (33) and (34); frames and signs as corrected: log(H⁻¹H_d) is a twist in
the axes of the frame, and so are J and J̇q̇.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import logm

from hoap3.remote_controller.solvers.qp.reference import solve_qp

Array = NDArray[np.float64]
Sides = tuple[Array, Array]


def tsid(
    J: Array,
    y: Array,
    w: float,
    p: Array,
    M: Array,
    h: Array,
    ddq: Sides,
    effort: Array,
    rows: tuple[Array, Array, Array],
) -> tuple[Array, Array] | None:
    """(33): min |y − J q̈|² + w|p − q̈|², τ = M q̈ + h, within q̈'s bounds and |τ| ≤ effort.

    Args:
        J, y: (m, n) and v̇_d − J̇q̇, (m,).
        w, p: weight of the posture, and q̈ᵖ, (n,).
        M, h: (n, n) and (n,).
        ddq: q̈'s lower and upper bounds, (n,).
        effort: τ_max, (n,).
        rows: R (s, n), and the lower and upper sides of R q̈, (s,).

    Returns:
        q̈ and τ, (n,); None where nothing satisfies all.
    """
    one = np.eye(p.size)
    V = np.vstack([one, M, rows[0]])
    lower = np.concatenate([ddq[0], -effort - h, rows[1]])
    upper = np.concatenate([ddq[1], effort - h, rows[2]])
    found = solve_qp(J.T @ J + w * one, J.T @ y + w * p, V, lower, upper)
    return None if found is None else (found, M @ found + h)


def desired_acceleration(
    H: Array, goal: Array, twist: Array, kp: float, kd: float
) -> tuple[Array, Array]:
    """(34): e = log(H⁻¹H_d) and v̇_d = kp·e − kd·ν; H and H_d (4, 4), ν = J q̇ (6,), v before ω."""
    xi = np.real(logm(np.linalg.solve(H, goal)))
    error = np.array([*xi[:3, 3], xi[2, 1], xi[0, 2], xi[1, 0]])
    return error, kp * error - kd * twist
