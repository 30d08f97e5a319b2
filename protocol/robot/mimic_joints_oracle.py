"""Inertia and accelerations of joints that are tied, in plain numpy.

`mimic_joints_kernels` is compared with it: M = Gᵀ·M_m·G, and the ddq of (M + D)·ddq = τ.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def tied_inertia(full: Array, G: Array) -> Array:
    """Gᵀ·M_m·G, (n, n), of the upper triangle of M_m, (m, m), and G, (m, n), in one order."""
    return np.asarray(G.T @ (np.triu(full) + np.triu(full, 1).T) @ G)


def accelerations(mass: Array, added: Array, torque: Array) -> Array:
    """ddq, (n,), of the torques τ where M has `added`, (n,), on its diagonal."""
    return np.asarray(np.linalg.solve(mass + np.diag(added), torque))
