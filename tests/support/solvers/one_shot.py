"""One problem for each solver class: sequences in, new arrays out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError, InfeasibleError, SolverError
from hoap3.remote_controller import solvers
from hoap3.remote_controller.solvers import Ghc, Pinv, Qp12, SdpGains, StableQp
from hoap3.remote_controller.solvers.base import status as codes
from hoap3.remote_controller.solvers.lyapunov_qp.descent_rate import FORMS
from hoap3.remote_controller.solvers.lyapunov_qp.lp_norm import LpNorm
from hoap3.remote_controller.solvers.sdp.sdp_gains import DELTA

from .task_stacks import floats, limits_of, stacked

Array = NDArray[np.float64]


def check(status: int) -> None:
    """Raise `InfeasibleError` or `BadProblemError` where a kernel found no answer."""
    if status:
        kind = InfeasibleError if status == codes.INFEASIBLE else BadProblemError
        raise kind(codes.NAMES[status])


class BoundedQp12:
    """`bounded_qp12_kernel` with its work array, and errors in place of statuses."""

    def __init__(self, n: int, weights: ArrayLike | None = None) -> None:
        from hoap3.remote_controller.solvers.qp12 import bounded_qp12_kernels as kernels

        self._kernel, self._work = kernels.bounded_qp12_kernel, np.ones(kernels.work_shape(n))
        if weights is not None:
            self._work[0] = weights
        self.kkt_residual = np.inf

    def solve(self, *problem: Any) -> None:
        """Take gradient, decrease, γ, lower, upper and out."""
        *given, out = problem
        found = self._kernel(*given, self._work, out)
        self.kkt_residual = found if found >= 0.0 else np.inf
        check(int(-found) if found < 0.0 else codes.OK)


def qp12(gradient: ArrayLike, decrease: float, gamma: float) -> Array:
    slope = floats(gradient)
    u = np.empty_like(slope)
    Qp12(slope.size).solve(slope, decrease, gamma, u)
    return u


def qp12_bounded(
    gradient: ArrayLike,
    decrease: float,
    gamma: float,
    lower: ArrayLike,
    upper: ArrayLike,
    weights: ArrayLike | None = None,
) -> Array:
    slope = floats(gradient)
    u = np.empty_like(slope)
    solver = BoundedQp12(slope.size, weights)
    solver.solve(slope, decrease, gamma, floats(lower), floats(upper), u)
    return u


def lp_norm(gradient: ArrayLike, decrease: float, p: float) -> Array:
    slope = floats(gradient)
    solver = LpNorm(slope.size, p)
    found = solver.solve(slope, decrease, 0.0)
    check(codes.INFEASIBLE if found == codes.ZERO_GRADIENT else found)
    return solver.u


def descent_rate(
    form: str,
    V: float,
    gradient: Array,
    error: float,
    u_max: float = 0.6,
    beta: float = 46.0,
    eta: float = 1.0,
    kappa: float = 10.0,
) -> float:
    """Ψ, NaN for bad input."""
    from hoap3.remote_controller.solvers.lyapunov_qp.descent_rate_kernels import rate_kernel

    scales = (eta, kappa) if form in {"tanh", "exponential"} else (u_max, beta)
    return float(rate_kernel(FORMS.index(form), *scales, V, gradient, error))


def stable_qp(
    gradient: ArrayLike,
    psi: float,
    drift: float = 0.0,
    gamma: float = 0.5,
    *,
    A: ArrayLike | None = None,
    b: ArrayLike | None = None,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
) -> StableQp:
    """The solver after one solve."""
    slope = floats(gradient)
    n = slope.size
    rows, sides = (np.zeros((0, n)), np.zeros(0)) if A is None or b is None else (A, b)
    least, most = -np.inf if lower is None else lower, np.inf if upper is None else upper
    solver = StableQp(n, len(sides), gamma=gamma)  # type: ignore[arg-type]
    bounds = (floats(np.broadcast_to(each, n)) for each in (least, most))
    solver.solve(slope, psi, drift, floats(rows), floats(sides), *bounds)
    return solver


def generalized_projector(
    alpha_rows: ArrayLike, jacobian: ArrayLike, *, smoothing: float = 0.0
) -> Array:
    """P (11) of a task, (n, n): priorities of the rows over it, (m,), and all rows, (m, n)."""
    from hoap3.remote_controller.solvers.ghc import projector_kernels

    J = floats(jacobian)
    P = np.empty((J.shape[1], J.shape[1]))
    check(projector_kernels.projector_kernel(floats(alpha_rows), J, smoothing, P))
    return P


def pinv(jacobian: ArrayLike, error: ArrayLike, decrease: float) -> Array:
    J = floats(jacobian)
    u = np.empty(J.shape[1])
    Pinv(*J.shape).solve(J, floats(error), decrease, u)
    return u


def pinv_plain(jacobian: ArrayLike, error: ArrayLike, gain: float) -> Array:
    J = floats(jacobian)
    u = np.empty(J.shape[1])
    Pinv(*J.shape).solve_plain(J, floats(error), gain, u)
    return u


def ghc(
    jacobians: Sequence[ArrayLike],
    targets: Sequence[ArrayLike],
    alpha: ArrayLike,
    M: ArrayLike,
    bias: ArrayLike,
    w_r: float,
    *,
    regularise: str = "gravity_compensated",
    smoothing: float = 0.0,
    **limits: Any,
) -> tuple[Array, Array]:
    """q̈ and τ; `InfeasibleError` or `SolverError` where the status is not OK."""
    stack = stacked(jacobians, targets, M, bias)
    given = limits_of(stack.n, **limits)
    rows = len(given.rows)
    solver = Ghc(stack.sizes, stack.n, regularise=regularise, smoothing=smoothing, rows=rows)
    for name, side in given._asdict().items():
        getattr(solver, name)[:] = side
    arrays = stack.jacobian, stack.targets, floats(alpha), stack.mass, stack.bias
    status = solver.solve(*arrays, w_r)
    if status:
        kind = InfeasibleError if status == codes.INFEASIBLE else SolverError
        raise kind(codes.NAMES[status])
    return solver.qdd, solver.tau


def hqp(
    jacobians: Sequence[ArrayLike],
    targets: Sequence[ArrayLike],
    M: ArrayLike,
    bias: ArrayLike,
    w_r: float,
    *,
    levels: Sequence[Sequence[int]] | None = None,
    **limits: Any,
) -> tuple[Array, Array]:
    """Every task is a level of its own unless `levels` are given."""
    stack = stacked(jacobians, targets, M, bias)
    order = [[i] for i in range(len(stack.sizes))] if levels is None else levels
    dynamics = stack.mass, stack.bias, w_r
    given = stack.jacobian, stack.targets, stack.sizes, order, *dynamics
    return solvers.hqp(*given, limits_of(stack.n, **limits))


def weighted(
    jacobians: Sequence[ArrayLike],
    targets: Sequence[ArrayLike],
    weights: ArrayLike,
    M: ArrayLike,
    bias: ArrayLike,
    w_r: float,
    *,
    regularise: str = "gravity_compensated",
    towards: ArrayLike | None = None,
    **limits: Any,
) -> tuple[Array, Array]:
    stack = stacked(jacobians, targets, M, bias)
    dynamics = stack.mass, stack.bias, w_r
    given = stack.jacobian, stack.targets, stack.sizes, floats(weights), *dynamics
    rest = np.zeros(stack.n) if towards is None else floats(towards)
    return solvers.weighted(
        *given, limits_of(stack.n, **limits), regularise=regularise, towards=rest
    )


def sdp_gains(
    jacobians: Sequence[ArrayLike],
    errors: Sequence[ArrayLike],
    dt: float,
    dq_lower: ArrayLike,
    dq_upper: ArrayLike,
    beta_desired: float,
    delta: float = DELTA,
    **options: Any,
) -> SdpGains:
    """The solver after one solve."""
    J = floats(np.vstack(jacobians))
    weights = options.pop("weights", None)
    solver = SdpGains([len(each) for each in errors], J.shape[1], **options)
    if weights is not None:
        solver.weights[:] = weights
    solver.lower[:], solver.upper[:] = dq_lower, dq_upper
    solver.solve(J, floats(np.concatenate(errors)), dt, beta_desired, delta)
    return solver
