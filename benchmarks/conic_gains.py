"""The gains by general solvers of conic programs, to compare ours with: Clarabel and SCS.

Neither is accurate in λ, in which the objective is nearly flat, so Newton's method follows
(`active_set_newton`) unless `polished` is False.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.sdp_backends import ConicForm, clarabel
from hoap3.remote_controller.solvers.base import status as codes
from hoap3.remote_controller.solvers.sdp.sdp_gains import BUDGET, DELTA, IPM, NONE, SdpGains

Array = NDArray[np.float64]
Program = tuple[Any, Array, Any, Array, int, int]

POLISH = 40  # Newton steps


def scs(
    P: Any, q: Array, A: Any, b: Array, limits: int, size: int, tolerance: float = 1e-7
) -> tuple[Array, Array]:
    """The same by SCS (MIT licence), an operator splitting; its triangle is the lower one."""
    import scs as library

    columns, rows = np.tril_indices(size)  # rows ≤ columns, by columns
    number = np.zeros((size, size), np.intp)
    number[rows, columns] = number[columns, rows] = np.arange(rows.size)
    lower = [number[i, j] for j in range(size) for i in range(j, size)]
    order = np.concatenate([np.arange(limits), limits + np.array(lower)]).astype(np.intp)
    data = {"P": P, "q": q, "A": A[order], "b": b[order], "c": q}
    data["A"] = data["A"].tocsc()
    settings = {"verbose": False, "eps_abs": tolerance, "eps_rel": tolerance}
    model = library.SCS(data, {"l": limits, "s": [size]}, max_iters=50_000, **settings)
    found = model.solve()
    z = np.empty(b.size)
    z[order] = found["y"]
    return np.asarray(found["x"]), z


SOLVERS = {"clarabel": clarabel, "scs": scs}


class ConicGains(SdpGains):
    """`SdpGains` by Clarabel or SCS, each time from nothing; it allocates.

    Args:
        solver: "clarabel" or "scs".
        polished: whether Newton's method follows.

    Attributes:
        polish: whether it arrived; the path is "ipm" either way.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        joints: int,
        *,
        solver: str = "clarabel",
        polished: bool = True,
        budget: int = POLISH,
    ) -> None:
        from hoap3.remote_controller.solvers.sdp import (
            certificate_kernels,
            driver_kernels,
            memory_kernels,
            sdp_kernels,
        )

        super().__init__(sizes, joints, budget=budget)
        self._solve_conic, self._polished, self.polish = SOLVERS[solver], polished, False
        self._polish, self._certify = driver_kernels.polish, certificate_kernels.certify
        self._enough, self._fastest = sdp_kernels.PROVED, sdp_kernels.FASTEST
        self._over = certificate_kernels.OVER
        self._form, self._program = ConicForm(self.n, self.joints), memory_kernels.Program

    def program(
        self, jacobian: Array, errors: Array, dt: float, desired: float, delta: float = DELTA
    ) -> Program | None:
        """What the solver is given, as for `SdpGains.solve`; None where that says what is wrong."""
        self.forget()
        budget, self.budget = self.budget, 0  # prepares L, Sᵀ and the limits, no more
        super().solve(jacobian, errors, dt, desired, delta)
        self.budget, self.polish = budget, False
        if self.path != BUDGET:
            return None
        desired = min(desired, self._fastest / dt)
        m, form = self._memory, self._form
        P, q, A, b = form.fill(m.L, m.St, m.limits, dt * desired, delta)
        return P, q, A, b, form.used.size, form.size

    def solve(
        self, jacobian: Array, errors: Array, dt: float, desired: float, delta: float = DELTA
    ) -> int:
        """As `SdpGains.solve`; the status is `OK` only where the gap proves it."""
        program = self.program(jacobian, errors, dt, desired, delta)
        if program is None:
            return self.status
        desired = min(desired, self._fastest / dt)
        m, n = self._memory, self.n
        given = self._program(m.L, m.G, m.St, m.limits, dt * desired, delta)
        x, dual = self._solve_conic(*program)
        form, each = self._form, np.zeros(2 * self.joints)
        used = form.used
        each[used] = np.maximum(dual[: used.size], 0.0)
        m.dual.z[1], m.dual.z[0] = each[: self.joints], each[self.joints :]
        whole = np.zeros((form.size, form.size))
        entries = dual[used.size :] / form.roots
        whole[form.rows, form.columns] = whole[form.columns, form.rows] = entries
        m.dual.Z[:] = whole[:n, :n]
        m.points.x[:] = x
        if self._polished:
            self.polish, self.newton = self._polish(
                given, self.budget, m.points, m.active, m.dual, m.work
            )
        self.beta, self.slack, self.margin, self.gap, kept = self._certify(
            given, m.points.x, m.dual, m.work.check
        )
        self.beta, self.slack, self.margin = (
            desired * value for value in (self.beta, self.slack, self.margin)
        )
        self.gains[:] = desired * m.points.x[:n]
        whole_dq = self.fed + desired * m.work.check.speed
        np.clip(whole_dq, self.lower, self.upper, out=self.dq)
        beyond = np.abs(whole_dq - self.dq)
        self.cut = bool((beyond > self._over * (1.0 + np.abs(self.dq))).any())
        self.rank, self.path = int(m.active.counts[0]), IPM if kept else NONE
        proved = self.gap <= self._enough
        self.gap *= desired * desired
        self.status = (codes.OK if proved else codes.UNSOLVED) if kept else codes.STATIONARY
        return self.status
