"""What the convenient functions make of their arguments before a kernel sees them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError

KERNEL_ARRAYS = (
    "Arrays must be numpy float64, C-contiguous, aligned and writable, such as "
    "np.ascontiguousarray(x, dtype=np.float64)."
)


def array(name: str, value: ArrayLike, dimensions: int) -> NDArray[np.float64]:
    """The value as an array that kernels accept; a copy only where it is not one already.

    Raises:
        BadProblemError: it is not made of real numbers, or has another number of dimensions.
    """
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "biuf":
            raise TypeError(f"it holds {given.dtype}")
        found = np.require(given, np.float64, ["C", "A", "W"])
    except (TypeError, ValueError) as error:
        raise BadProblemError(f"{name} must be an array of real numbers: {error}.") from error
    if found.ndim != dimensions:
        raise BadProblemError(
            f"{name} has shape {found.shape}; give it {dimensions} dimension"
            f"{'s' if dimensions > 1 else ''}."
        )
    return found


def number(name: str, value: float) -> float:
    """The value as a float.

    Raises:
        BadProblemError: it is not a real number.
    """
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise BadProblemError(f"{name} must be a real number: {error}.") from error


def check_sizes(solver: str, sizes: Sequence[int], joints: int) -> None:
    """Refuse a stack of tasks without rows, or a robot without joints.

    Raises:
        BadProblemError: there is no task, one has no row, or there is no joint.
    """
    if joints < 1 or len(sizes) < 1 or min(sizes) < 1:
        raise BadProblemError(
            f"{solver}: give it joints, and tasks of one row or more (found n = {joints}, sizes "
            f"{list(sizes)})."
        )
