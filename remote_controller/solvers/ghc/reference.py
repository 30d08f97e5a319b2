"""Projectors that the generalized one is compared with.

Liu, Tan and Padois, Autonomous Robots 2015, (5), (6) and (8), all of other authors. For
experiments: each call decomposes with numpy and checks nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
RANK_TOLERANCE = 1e-9  # of the largest singular value


def damped_null_space(alpha: float, jacobian: ArrayLike) -> Array:
    """N′ = I − α J⁺J (5): two levels only, and one priority for a whole task.

    Args:
        alpha: priority of the rows, 0 to 1.
        jacobian: (m, n).
    """
    J = np.asarray(jacobian, dtype=np.float64)
    inverse = np.asarray(np.linalg.pinv(J, rcond=RANK_TOLERANCE), dtype=np.float64)
    return _projector(alpha * inverse, J)


def activated_null_space(theta: ArrayLike, jacobian: ArrayLike) -> Array:
    """N″ = I − V Θ Vᵀ (6): priorities of the right singular vectors, not of the rows.

    Args:
        theta: activations, (n,), in descending order of the singular values.
        jacobian: (m, n).
    """
    V = np.linalg.svd(np.asarray(jacobian, dtype=np.float64), full_matrices=True)[2].T
    return _projector(V * np.asarray(theta, dtype=np.float64), V.T)


def summed_null_space(alpha_rows: ArrayLike, jacobian: ArrayLike) -> Array:
    """N‴ = I − Σ_j α_j J_jᵀJ_j / |J_j|² (8): leaks where rows are not orthogonal, as (9) says.

    Args:
        alpha_rows: priority of each row, (m,).
        jacobian: (m, n); zero rows are skipped.
    """
    J = np.asarray(jacobian, dtype=np.float64)
    length = np.linalg.norm(J, axis=1)
    kept = length > 0.0
    unit = J[kept] / length[kept, None]
    return _projector(unit.T * np.asarray(alpha_rows, dtype=np.float64)[kept], unit)


def _projector(weighted: Array, rows: Array) -> Array:
    """I − weighted·rows."""
    found: Array = np.eye(rows.shape[1]) - weighted @ rows
    return found
