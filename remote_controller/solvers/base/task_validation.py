"""What the convenient functions for hierarchies of tasks make of their arguments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError, InfeasibleError
from hoap3.remote_controller.solvers.base.validation import array

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stack:
    """Tasks on top of each other, and the equation of motion.

    Attributes:
        sizes: rows of each task.
        n: number of joints.
        jacobian, targets: (m, n) and (m,).
        mass, bias: (n, n) and (n,).
    """

    sizes: list[int]
    n: int
    jacobian: Array
    targets: Array
    mass: Array
    bias: Array


def stacked(
    who: str,
    jacobians: Sequence[ArrayLike],
    targets: Sequence[ArrayLike],
    M: ArrayLike,
    bias: ArrayLike,
) -> Stack:
    """Check and stack the tasks.

    Raises:
        BadProblemError: wrong shape, or a value that is not finite; it says which.
    """
    if not len(jacobians):
        raise BadProblemError(f"{who}: give it at least one task.")
    if len(targets) != len(jacobians):
        raise BadProblemError(
            f"{who}: {len(jacobians)} Jacobians and {len(targets)} targets; give one of each for "
            "each task."
        )
    rows = [array(f"jacobians[{i}]", J, 2) for i, J in enumerate(jacobians)]
    wanted = [array(f"targets[{i}]", b, 1) for i, b in enumerate(targets)]
    n = rows[0].shape[1]
    mass, pull = array("M", M, 2), array("bias", bias, 1)
    for i, (J, b) in enumerate(zip(rows, wanted, strict=True)):
        fit(f"jacobians[{i}]", J, (max(J.shape[0], 1), n))
        fit(f"targets[{i}]", b, J.shape[:1])
    fit("M", mass, (n, n))
    fit("bias", pull, (n,))
    sizes = [len(b) for b in wanted]
    return Stack(sizes, n, np.vstack(rows), np.concatenate(wanted), mass, pull)


def fit(name: str, value: Array, shape: tuple[int, ...]) -> None:
    """Refuse a wrong shape, and what is not finite.

    Raises:
        BadProblemError: either.
    """
    if value.shape != shape:
        raise BadProblemError(f"{name} has shape {value.shape}; give it {shape}.")
    if not np.isfinite(value).all():
        raise BadProblemError(f"{name} must be finite.")


def bounds_of(
    n: int,
    qdd_lower: ArrayLike | None,
    qdd_upper: ArrayLike | None,
    tau_lower: ArrayLike | None,
    tau_upper: ArrayLike | None,
) -> tuple[Array, Array, Array, Array]:
    """Bounds as arrays, ∓inf where there are none.

    Raises:
        BadProblemError: wrong shape, NaN, or infinite on the wrong side.
        InfeasibleError: a lower one is above the upper one.
    """
    given = {
        "qdd_lower": (qdd_lower, -np.inf),
        "qdd_upper": (qdd_upper, np.inf),
        "tau_lower": (tau_lower, -np.inf),
        "tau_upper": (tau_upper, np.inf),
    }
    found = {name: _bound(name, value, n, none) for name, (value, none) in given.items()}
    for kind in ("qdd", "tau"):
        apart = found[f"{kind}_lower"] > found[f"{kind}_upper"]
        if apart.any():
            raise InfeasibleError(
                f"{kind}_lower is above {kind}_upper for joint {int(np.argmax(apart))}."
            )
    return found["qdd_lower"], found["qdd_upper"], found["tau_lower"], found["tau_upper"]


def rows_of(
    n: int,
    rows: ArrayLike | None,
    lower: ArrayLike | None,
    upper: ArrayLike | None,
) -> tuple[Array, Array, Array]:
    """R (s, n) of rows of q̈ and their bounds (s,), ∓inf where there are none.

    Raises:
        BadProblemError: wrong shape, NaN, or infinite on the wrong side; bounds without rows.
        InfeasibleError: a lower one is above the upper one.
    """
    if rows is None:
        if lower is not None or upper is not None:
            raise BadProblemError("rows_lower and rows_upper need rows; give them, (s, n).")
        return np.zeros((0, n)), np.zeros(0), np.zeros(0)
    R = array("rows", rows, 2)
    s = R.shape[0]
    fit("rows", R, (s, n))
    least = _bound("rows_lower", lower, s, -np.inf)
    most = _bound("rows_upper", upper, s, np.inf)
    if (least > most).any():
        raise InfeasibleError(
            f"rows_lower is above rows_upper for row {int(np.argmax(least > most))}."
        )
    return R, least, most


def _bound(name: str, value: ArrayLike | None, size: int, none: float) -> Array:
    bound = np.full(size, none) if value is None else array(name, value, 1)
    if bound.shape != (size,):
        raise BadProblemError(f"{name} has shape {bound.shape}; give it {(size,)}.")
    if np.isnan(bound).any() or (bound == -none).any():
        raise BadProblemError(f"{name} must hold numbers, or {none} for no bound.")
    return bound
