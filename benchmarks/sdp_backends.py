"""The certified gains as a general conic program, and Clarabel, which solves it.

Marti-Saumell et al. (24) to (29) with the objective as a quadratic one:

    min ½ xᵀP x + qᵀx   subject to   A x + s = b,  s ∈ K,   x = (λ, β)

K: the limits of S λ, then the 2n × 2n matrix inequality whose Schur complement `lmi_kernels` has,
[L Λ + Λ Lᵀ − βI, √Δt Λ Lᵀ; √Δt L Λ, I] ⪰ 0, as its upper triangle, column by column, off-diagonals
times √2.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

PACKAGES = {"clarabel": "clarabel", "scs": "scs"}
"""Packages of the solvers; `benchmarks.conic_gains` has SCS."""


def installed() -> list[str]:
    """Names of the solvers that can be used."""
    return [name for name, package in PACKAGES.items() if find_spec(package)]


class ConicForm:
    """The program for n rows of tasks and some joints; it allocates.

    Attributes:
        size: of the matrix.
        used: which rows of ±S A has: those with a finite limit, the upper ones first.
        rows, columns: of the entries of the triangle.
        roots: 1 on its diagonal, √2 beside it.
    """

    def __init__(self, n: int, joints: int) -> None:
        self.size, self._n, self._joints = 2 * n, n, joints
        self.columns, self.rows = np.tril_indices(self.size)
        self.roots = np.where(self.rows == self.columns, 1.0, np.sqrt(2.0))
        number = np.zeros((self.size, self.size), np.intp)
        number[self.rows, self.columns] = number[self.columns, self.rows] = np.arange(
            self.rows.size
        )
        i, j = np.divmod(np.arange(n * n), n)  # λ_i, by columns of A, times L_ji
        self._of_L, each = (j, i), np.arange(n)
        self._above = -np.where(i == j, 2.0, 1.0) * self.roots[number[i, j]]
        self._beside = -self.roots[number[i, n + j]]
        self._entries = np.hstack([number[i, j].reshape(n, n), number[i, n + j].reshape(n, n)])
        self._diagonal = number[each, each]
        self._constant = ((self.rows == self.columns) & (self.rows >= n)).astype(float)
        self.used: Indices = np.arange(0)
        self._lay_out()

    def _lay_out(self) -> None:
        """Places of the entries of A, by columns: limits, L Λ + Λ Lᵀ, √Δt L Λ; and β's column."""
        n, limits = self._n, self.used.size
        first = np.broadcast_to(np.arange(limits), (n, limits))
        whole = np.hstack([first, limits + self._entries])
        self._indices = np.concatenate([whole.ravel(), limits + self._diagonal]).astype(np.int32)
        ends = np.append(np.arange(n + 1) * whole.shape[1], whole.size + n)
        self._indptr = ends.astype(np.int32)

    def fill(
        self, L: Array, St: Array, limits: Array, dt: float, delta: float
    ) -> tuple[Any, Array, Any, Array]:
        """P, q, A and b in the units of β̃ = 1.

        Args:
            L: (n, n).
            St: Sᵀ of (24), (n, joints).
            limits: of S λ, (2, joints), ∓inf where there is none.
            dt, delta: Δt β̃ and δ.
        """
        from scipy import sparse

        n = self._n
        bounds = np.concatenate([limits[1], -limits[0]])
        used = np.flatnonzero(np.isfinite(bounds))
        if not np.array_equal(used, self.used):
            self.used = used
            self._lay_out()
        gains = L[self._of_L]
        signed = np.hstack([St, -St])[:, used]
        above, beside = self._above * gains, np.sqrt(dt) * self._beside * gains
        whole = np.hstack([signed, above.reshape(n, n), beside.reshape(n, n)])
        data = np.concatenate([whole.ravel(), np.ones(n)])
        shape = (used.size + self.rows.size, n + 1)
        A = sparse.csc_matrix((data, self._indices.copy(), self._indptr.copy()), shape)
        A.eliminate_zeros()
        A.sort_indices()
        P = sparse.csc_matrix(
            (np.append(np.full(n, 2.0 * delta), 2.0), np.arange(n + 1), np.arange(n + 2)),
            (n + 1, n + 1),
        )
        return P, np.append(np.zeros(n), -2.0), A, np.concatenate([bounds[used], self._constant])


def conic(
    L: Array, St: Array, limits: Array, dt: float, delta: float
) -> tuple[Any, Array, Any, Array, NDArray[np.intp], int]:
    """P, q, A and b of `ConicForm.fill`, which rows of ±S A has, and the matrix's size."""
    form = ConicForm(*St.shape)
    return (*form.fill(L, St, limits, dt, delta), form.used, form.size)


def clarabel(P: Any, q: Array, A: Any, b: Array, limits: int, size: int) -> tuple[Array, Array]:
    """X and the multipliers, by Clarabel (Apache licence), an interior-point method."""
    import clarabel as library

    settings = library.DefaultSettings()
    settings.verbose = False
    cones = [library.NonnegativeConeT(limits)] if limits else []
    cones.append(library.PSDTriangleConeT(size))
    found = library.DefaultSolver(P, q, A, b, cones, settings).solve()
    return np.array(found.x), np.array(found.z)
