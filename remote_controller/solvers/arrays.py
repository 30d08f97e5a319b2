"""What the convenient functions make of their arguments before a kernel sees them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from protocol.errors import BadProblemError

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


def positive(solver: str, name: str, value: ArrayLike, rows: int) -> NDArray[np.float64]:
    """A copy of positive numbers, one for each row of the tasks.

    Raises:
        BadProblemError: there are more or fewer, or one is not positive and finite.
    """
    found = array(name, value, 1).copy()
    if found.shape != (rows,) or not np.all((found > 0) & np.isfinite(found)):
        raise BadProblemError(
            f"{solver}: {name} must be {rows} positive numbers, one for each row of the tasks "
            f"(found {found})."
        )
    return found
