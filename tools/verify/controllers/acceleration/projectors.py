"""The generalized projector of Liu, Tan and Padois (2015), (11), of many cycles at once.

P = (1 − a_1) I + Σ (a_l − a_{l+1}) N_l, where a_1 > … > a_L are the priorities of tasks over one,
and N_l projects onto what the rows of all tasks of priority a_l or more leave free.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RANK = 1e-8  # of a singular value of unit rows: less is rounding
NARROWEST = 1e-5  # of the Frobenius norm: least width in which a direction fades out


class Projectors:
    """Of one stack of rows.

    Args:
        J: all rows, (N, m, n).
        edges: where each task's rows begin, and m.
        width: singular values below it fade out; 0: none does.
    """

    def __init__(self, J: Array, edges: Sequence[int] | Array, width: float) -> None:
        self._J, self._edges, self._width = J, edges, width
        self._known: dict[tuple[bool, ...], Array] = {}
        parts = [J[:, start:end] for start, end in pairwise(edges)]
        self._whole = [_is_identity(part) for part in parts]  # which leave nothing free

    def of(self, alpha: Array) -> Array:
        """P (N, n, n) for priorities of all tasks over one, (N, k)."""
        N, _, n = self._J.shape
        P = np.zeros((N, n, n))
        kinds, places = np.unique(alpha, axis=0, return_inverse=True)
        for number, row in enumerate(kinds):
            mine = places.ravel() == number
            levels = [*sorted({float(a) for a in row if a > 0.0}, reverse=True), 0.0]
            P[mine] += (1.0 - levels[0]) * np.eye(n)
            for level, below in pairwise(levels):
                P[mine] += (level - below) * self._free(tuple((row >= level).tolist()))[mine]
        return P

    def _free(self, tasks: tuple[bool, ...]) -> Array:
        """N_l of some tasks in all cycles."""
        if tasks not in self._known:
            n = self._J.shape[2]
            if any(self._whole[place] for place in np.flatnonzero(tasks)):
                self._known[tasks] = np.zeros((len(self._J), n, n))
            else:
                rows = self._J[:, np.repeat(np.array(tasks), np.diff(self._edges))]
                self._known[tasks] = self._projector(rows)
        return self._known[tasks]

    def _projector(self, rows: Array) -> Array:
        n = rows.shape[2]
        if self._width > 0.0:
            _, s, Vt = np.linalg.svd(rows, full_matrices=False)
            least = np.maximum(self._width, NARROWEST * np.linalg.norm(rows, axis=(1, 2)))
            t = np.minimum(s / least[:, None], 1.0)
            shares = 3.0 * t**2 - 2.0 * t**3
        else:
            length = np.linalg.norm(rows, axis=2, keepdims=True)
            _, s, Vt = np.linalg.svd(
                rows / np.where(length > 0.0, length, 1.0), full_matrices=False
            )
            shares = (s > RANK).astype(float)
        return np.asarray(np.eye(n) - np.swapaxes(Vt, 1, 2) * shares[:, None, :] @ Vt)


def _is_identity(J: Array) -> bool:
    """Whether a task's rows are I in all cycles, as those of all joints are."""
    n = J.shape[2]
    return J.shape[1] == n and bool((np.eye(n) == J).all())
