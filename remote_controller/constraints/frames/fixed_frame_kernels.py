"""Compiled: how far a frame is from the pose that it keeps, and how joints change that."""

from __future__ import annotations

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import Indices, kernel


@kernel("f8(f8[::1], f8[:,::1], f8[::1], f8[:,::1], f8[:,::1], i8[::1], f8, f8[:,::1], f8[::1])")
def kept_rows(
    position: FloatArray,
    rotation: FloatArray,
    position_kept: FloatArray,
    rotation_kept: FloatArray,
    jacobian: FloatArray,
    axes: Indices,
    rate: float,
    A_out: FloatArray,
    b_out: FloatArray,
) -> float:
    """Rows ∂e/∂q and right sides −rate·e of the chosen axes; the largest |e| of them.

    e is the displacement p − p₀ over sin θ·a, for the rotation D = R·R₀ᵀ by θ about a. The vector
    of D − Dᵀ is 2 sin θ·a, and of Ḋ = ω × D it is (tr D·I − D)·ω.

    Args:
        position, rotation: p (3,) [m] and R (3, 3) of the frame, seen from the reference.
        position_kept, rotation_kept: p₀ and R₀.
        jacobian: (6, n) dp/dq over the angular velocity, in the reference's axes.
        axes: (rows,) which of x, y, z and the rotations about them, 0 to 5.
        rate: [1/s], or [1/s²] for rows of accelerations.
        A_out: (rows, n) written.
        b_out: (rows,) written.
    """
    worst, trace = 0.0, 0.0
    for i in range(3):
        for j in range(3):
            trace += rotation[i, j] * rotation_kept[i, j]
    for row in range(axes.size):
        axis = axes[row]
        if axis < 3:
            error = position[axis] - position_kept[axis]
            for joint in range(jacobian.shape[1]):
                A_out[row, joint] = jacobian[axis, joint]
        else:
            i = axis - 3
            j, k = (i + 1) % 3, (i + 2) % 3
            error, own, along_j, along_k = 0.0, 0.0, 0.0, 0.0  # D's row i in the order i, j, k
            for column in range(3):
                error += rotation[k, column] * rotation_kept[j, column]
                error -= rotation[j, column] * rotation_kept[k, column]
                own += rotation[i, column] * rotation_kept[i, column]
                along_j += rotation[i, column] * rotation_kept[j, column]
                along_k += rotation[i, column] * rotation_kept[k, column]
            error *= 0.5
            own, along_j, along_k = 0.5 * (trace - own), -0.5 * along_j, -0.5 * along_k
            for joint in range(jacobian.shape[1]):
                A_out[row, joint] = (
                    own * jacobian[3 + i, joint]
                    + along_j * jacobian[3 + j, joint]
                    + along_k * jacobian[3 + k, joint]
                )
        b_out[row] = -rate * error
        worst = max(worst, abs(error))
    return worst
