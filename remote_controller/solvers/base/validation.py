"""What the convenient functions make of their arguments before a kernel sees them."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError, InfeasibleError, SolverError
from hoap3.remote_controller.solvers.base.status import BAD_SHAPE, INFEASIBLE, OUT_OF_RANGE

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


def squarable(name: str, value: float) -> float:
    """The value as a float that is not negative, and whose square is finite.

    Raises:
        BadProblemError: it is not.
    """
    found = number(name, value)
    if not (found >= 0.0 and math.isfinite(found * found)):
        raise BadProblemError(
            f"{name} must be finite and not negative, and so must its square (found {found}). "
            "Give 0 for none."
        )
    return found


def whole(solver: str, name: str, value: Any, meaning: str) -> int:
    """The value as an int of 1 or more.

    Args:
        solver, name: who asks for what, for errors.
        value: what was given.
        meaning: what it is the number of.

    Raises:
        BadProblemError: it is no whole number, such as 2.5, 2.0 or True, or less than 1.
    """
    try:
        found = 0 if isinstance(value, bool) else operator.index(value)
    except TypeError:
        found = 0
    if found < 1:
        raise BadProblemError(
            f"{solver}: {name} must be a whole number, 1 or more (found {value!r:.60}). Give the "
            f"number of {meaning} as an int."
        )
    return found


def sizes_of(solver: str, sizes: Sequence[int]) -> list[int]:
    """Numbers of rows of the tasks.

    Raises:
        BadProblemError: there is no task, or a size is no whole number of 1 or more.
    """
    try:
        given: list[Any] = list(sizes)
    except TypeError:  # not a list of anything
        given = []
    if not given:
        raise BadProblemError(
            f"{solver}: sizes must be a list of one task or more (found {sizes!r:.60}). Give each "
            "task's number of rows, such as [3, 1]."
        )
    return [
        whole(solver, f"sizes[{place}]", size, "rows of the task")
        for place, size in enumerate(given)
    ]


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


def no_descent(
    solver: str, status: int, decrease: float, shapes: str, numbers: str, within: str = ""
) -> SolverError:
    """The error of a solver of ∇V·u = −decrease that has no answer.

    Args:
        solver, status, decrease: who says what of which demand.
        shapes: what shapes the arrays must have.
        numbers: what the numbers must be.
        within: why no input reaches the decrease, and what to do; by default ∇V = 0.
    """
    if status == INFEASIBLE:
        return InfeasibleError(
            within
            or f"{solver}: the gradient is zero, so no input can reach a decrease of {decrease}. "
            "Let the decrease vanish with the gradient."
        )
    if status == BAD_SHAPE:
        return BadProblemError(f"{solver}: {shapes}")
    if status == OUT_OF_RANGE:
        return BadProblemError(
            f"{solver}: a decrease of {decrease} along so small a gradient needs an input beyond "
            "1e307. Let the decrease vanish with the gradient, and check the units."
        )
    return BadProblemError(f"{solver}: {numbers}")
