"""Arguments of problems with several tasks, as sequences: stacked, and with what is left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError, InfeasibleError
from hoap3.remote_controller.solvers.ghc.row_equations import Limits

Array = NDArray[np.float64]


def floats(values: ArrayLike) -> Array:
    """A contiguous copy."""
    return np.array(values, dtype=np.float64, order="C")


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
    jacobians: Sequence[ArrayLike], targets: Sequence[ArrayLike], M: ArrayLike, bias: ArrayLike
) -> Stack:
    rows, wanted = [floats(J) for J in jacobians], [floats(b) for b in targets]
    sizes = [len(b) for b in wanted]
    assert sizes == [len(J) for J in rows]
    stack = np.vstack(rows), np.concatenate(wanted)
    return Stack(sizes, rows[0].shape[1], *stack, floats(M), floats(bias))


def fit(name: str, value: Array, shape: tuple[int, ...]) -> None:
    if value.shape != shape:
        raise BadProblemError(f"{name} has shape {value.shape}; give it {shape}.")
    if not np.isfinite(value).all():
        raise BadProblemError(f"{name} must be finite.")


def limits_of(n: int, **given: Any) -> Limits:
    """Limits by their names, ∓inf where there are none.

    Raises:
        InfeasibleError: a lower one of q̈ or τ is above the upper one.
    """
    R = floats(given.pop("rows", np.zeros((0, n))))
    sides = []
    for name, size in (("qdd", n), ("tau", n), ("rows", len(R))):
        lower = floats(given.pop(f"{name}_lower", np.full(size, -np.inf)))
        upper = floats(given.pop(f"{name}_upper", np.full(size, np.inf)))
        if name != "rows" and (lower > upper).any():
            raise InfeasibleError(name)
        sides += [lower, upper]
    assert not given
    return Limits(*sides[:4], R, *sides[4:])
