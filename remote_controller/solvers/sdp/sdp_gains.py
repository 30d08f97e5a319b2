"""Gains of prioritised tasks with a proof that the errors fall.

Marti-Saumell, Santamaria-Navarro, Ocampo-Martinez and Andrade-Cetto, "Multi-task closed-loop
inverse kinematics stability through semidefinite programming": the tasks' errors e are brought down
by dq = B Λ e, B = [J_1⁺ | N_1 J_2⁺ | …], and the gains λ on the diagonal of Λ solve

    min (β − β̃)² + δ|λ|²   subject to   V⁺ ≤ (1 − β Δt) V,   lower ≤ dq ≤ upper

where V = ½ Σ w_i e_i² and V⁺ is its value a step later by the linear model e⁺ = (I − Δt L Λ) e,
L = [J_1; …; J_h] B. The condition on V is a matrix inequality (`lmi_kernels`), so a semidefinite
program results: n + 1 unknowns, one n × n matrix. ``SdpGains`` is for loops, ``sdp_gains`` for
everything else.

What is certified: that V falls as fast as `beta` says, for constant targets, by the linear model.
It is local, as the paper has it: how far the model holds depends on |dq| Δt.

* β does not exceed 1/Δt, at which every error vanishes in one step: a larger β̃ is met by 1/Δt. One
  above 100/Δt counts as 100/Δt, also in the objective.
* Where no gains make V fall (β* = 0), and there are such tasks even among independent ones, the
  status is ``STATIONARY``: gains and β are 0, and there is no certificate. Nearly dependent tasks
  have a β near 0: V falls, but need not converge.
* The first solve, and one after the active limits or the rank changed at once, takes an
  interior-point method; the others a few Newton steps from where the last two answers lead. So the
  last digits of an answer depend on the solves before. `forget` begins anew.
* `budget` counts iterations, not time, and what is done does not depend on the clock. When it is
  spent, the answer is the last gains, shortened until dq keeps its limits, or the best point that
  was found if that certifies more; the status is ``ITERATION_LIMIT``, β is what these gains
  certify, or 0 with gains of 0 where they certify nothing.

Whatever the status, `beta` is λ_min(−A − Aᵀ − Δt AᵀA), A = −L Λ, of the gains that are returned.
Where `cut` is set dq is not what these gains ask for, and nothing is certified.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError, SolverError
from hoap3.remote_controller.solvers.base import status as codes
from hoap3.remote_controller.solvers.base.validation import (
    KERNEL_ARRAYS,
    array,
    number,
    positive,
    sizes_of,
    squarable,
    whole,
)

Array = NDArray[np.float64]

PATHS = ("none", "warm", "ipm", "budget")
NONE, WARM, IPM, BUDGET = range(4)
DELTA = 5e-5  # of the paper
NAME = "SDP gains"


class SdpGains:
    """Finds gains for a stack of tasks and n joints without allocating anything.

    Args:
        sizes: number of rows of each task, the most important first.
        joints: number of joints.
        weights: w of V, one for each row; 1 by default. Weighting the upper tasks more lets
            hierarchies with many rows converge much faster; the certificate is that of the V
            that is weighted.
        damping: d: J_iᵀ(J_i J_iᵀ + d²I)⁻¹ stands for J_i⁺. L is that of the damped law, so the
            certificate covers it.
        budget: iterations that one solve may take.

    Attributes:
        lower, upper: limits of dq [rad/s], (joints,), to be written to; ∓inf at first. They hold
            lower ≤ 0 ≤ upper.
        rates: of the targets, σ̇*, (n,), to be written to; 0 at first. dq = B(Λ e + L⁻¹ σ̇*), so
            that ė = −L Λ e as for constant targets; where L is singular, or limits are in the way,
            dq = B(Λ e + σ̇*), cut to the limits. So it is with damping, which L⁻¹ would take out.
        fed: what the targets' rates take of dq, (joints,) [rad/s].
        fed_share: 1 where nothing of it was left because of limits.
        gains: λ [1/s], (n,).
        dq: joint speeds [rad/s], (joints,).
        beta: β [1/s] that the gains certify, where dq is not `cut`.
        cut: whether dq = B(Λ e + …) was cut off at its limits, because of what is fed forward; for
            who uses the solver alone: `clik_sdp` asks for more before it certifies.
        desired: β̃ that was asked for.
        path: index into `PATHS`.
        status: index into `status.NAMES`; `OK`, if the gains are proved to be optimal.
        slack: λ_min(C) [1/s] of the matrix inequality for the β of the program, which is active at
            the optimum: 0 but for rounding.
        margin: how near a joint comes to its limit [rad/s].
        gap: the objective, with β̃ as it counts, is at most this much above its optimum [1/s²], by
            duality; so β is at most its root from the optimal one.
        rank: of the multiplier of the matrix inequality, 0 where it is not known.
        task_rank: of the stacked Jacobian.
        newton, inner: iterations that were taken, of Newton's and the interior-point method.

    Raises:
        BadProblemError: no task; a size, a number of joints or a budget that is no whole number
            of 1 or more; weights that do not fit; a damping that is negative or not finite.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        joints: int,
        *,
        weights: ArrayLike | None = None,
        damping: float = 0.0,
        budget: int = 60,
    ) -> None:
        from hoap3.remote_controller.solvers.sdp import memory_kernels as memory
        from hoap3.remote_controller.solvers.sdp import sdp_kernels

        sizes = sizes_of(NAME, sizes)
        n = self.n = sum(sizes)
        self.joints = joints = whole(NAME, "joints", joints, "joints")
        self.budget = whole(NAME, "budget", budget, "iterations that one solve may take")
        self.damping = squarable("damping", damping)
        given = positive(NAME, "weights", [1] * n if weights is None else weights, n)
        self._kernel = sdp_kernels.sdp_gains_kernel
        columns = (math.isqrt(8 * n + 9) - 1) // 2  # of Y: r(r + 1)/2 ≤ n + 1
        unknowns = n + 1 + n * columns + n
        plan = np.concatenate([np.zeros(memory.INTEGERS + 6 * n + 1), np.cumsum(sizes)])
        self._work = (
            plan.astype(np.int64),
            np.zeros((memory.ROWS + (3 + memory.SQUARES) * n, n)),
            np.zeros((memory.TALL + 3 * n, joints)),
            np.zeros((memory.UNKNOWNS + unknowns, max(unknowns, joints))),
        )
        named = self._memory = memory.layout(*self._work)
        self._counts, self.offsets = named.active.counts, named.offsets
        self.rates, self.weights, self.gains = named.rates, named.weights, named.gains
        (self.lower, self.upper), self.dq, self.fed = named.speeds, named.dq, named.fed
        self.weights[:], self.lower[:], self.upper[:] = given, -math.inf, math.inf
        self._still()

    def _still(self) -> None:
        self.status, self.path, self.desired = codes.UNSOLVED, NONE, 0.0
        self.beta, self.slack, self.margin, self.gap = 0.0, 0.0, 0.0, math.inf
        self.fed_share, self.cut = 1.0, False
        self.rank = self.task_rank = self.newton = self.inner = 0

    def forget(self) -> None:
        """Begin the next solve without anything of the last one."""
        self._counts[:], self.gains[:] = 0, 0.0

    def solve(
        self, jacobian: Array, errors: Array, dt: float, desired: float, delta: float = DELTA
    ) -> int:
        """Find the gains and dq; see the attributes.

        Args:
            jacobian: the tasks' rows, (n, joints). Dependent and zero rows do no harm.
            errors: σ* − σ, (n,).
            dt: Δt [s].
            desired: β̃ [1/s], positive.
            delta: δ, positive.

        Returns:
            `status.OK`; `STATIONARY`: no gains have a certificate, and all are 0;
            `ITERATION_LIMIT`: the budget is spent; `UNSOLVED`: the gains are certified but not
            proved to be optimal, which happens where tasks nearly depend on each other;
            `OUT_OF_RANGE`: an answer overflows;
            `BAD_INPUT`: a value is not finite or outside its range; `BAD_SHAPE`.

        Raises:
            BadProblemError: wrong type of array.
        """
        self.desired = desired
        try:
            (
                self.status,
                self.path,
                self.task_rank,
                self.rank,
                self.newton,
                self.inner,
                self.beta,
                self.slack,
                self.margin,
                self.gap,
                self.fed_share,
                self.cut,
            ) = self._kernel(
                jacobian, errors, dt, desired, delta, self.damping, self.budget, *self._work
            )
        except TypeError as error:
            self._still()
            self.forget()
            self.dq[:] = 0.0
            raise BadProblemError(f"{NAME}: wrong type of argument. {KERNEL_ARRAYS}") from error
        if self.status == codes.BAD_SHAPE:
            self.forget()
            self.dq[:] = 0.0
        return self.status


def sdp_gains(
    jacobians: Sequence[ArrayLike],
    errors: Sequence[ArrayLike],
    dt: float,
    dq_lower: ArrayLike,
    dq_upper: ArrayLike,
    beta_desired: float,
    delta: float = DELTA,
    weights: ArrayLike | None = None,
    *,
    damping: float = 0.0,
) -> tuple[Array, float]:
    """Find gains for one state.

    Args:
        jacobians: J_i of each task, (n_i, joints), the most important first.
        errors: e_i = σ_i* − σ_i of each, (n_i,).
        dt: Δt [s].
        dq_lower, dq_upper: limits of the joint speeds [rad/s], (joints,), around 0; inf for none.
        beta_desired: β̃ [1/s]. More than 1/Δt is met by 1/Δt.
        delta: δ, what large gains cost.
        weights: w_i of V = ½ Σ w_i |e_i|², one for each task, or for each row; 1 by default.
        damping: d: J_iᵀ(J_i J_iᵀ + d²I)⁻¹ stands for J_i⁺.

    Returns:
        The gains λ [1/s], one for each row of the tasks, and β [1/s], which they certify. Both are
        0 where no gains have a certificate.

    Raises:
        BadProblemError: wrong shape, a value that is not finite or outside its range, a row of a
            Jacobian whose squared length overflows, or an answer that does.
    """
    if not len(jacobians) or len(jacobians) != len(errors):
        raise BadProblemError(
            f"{NAME}: give a Jacobian and errors for each task (found {len(jacobians)} "
            f"and {len(errors)})."
        )
    rows = [array(f"jacobians[{i}]", J, 2) for i, J in enumerate(jacobians)]
    targets = [array(f"errors[{i}]", e, 1) for i, e in enumerate(errors)]
    joints = rows[0].shape[1]
    for i, (J, e) in enumerate(zip(rows, targets, strict=True)):
        if J.shape != (e.size, joints) or e.size < 1:
            raise BadProblemError(
                f"jacobians[{i}] has shape {J.shape}; give it a row for each of {e.size} errors "
                f"and {joints} columns."
            )
    sizes = [e.size for e in targets]
    each = None if weights is None else array("weights", weights, 1)
    if each is not None and each.size == len(sizes):
        each = np.repeat(each, sizes)
    solver = SdpGains(sizes, joints, weights=each, damping=damping)
    for name, given, place in (
        ("dq_lower", dq_lower, solver.lower),
        ("dq_upper", dq_upper, solver.upper),
    ):
        limits = array(name, given, 1)
        if limits.shape != (joints,):
            raise BadProblemError(f"{name} has shape {limits.shape}; give it ({joints},).")
        place[:] = limits
    for i, J in enumerate(rows):
        _check_lengths(f"jacobians[{i}]", J)
    numbers = [number("dt", dt), number("beta_desired", beta_desired), number("delta", delta)]
    status = solver.solve(np.vstack(rows), np.concatenate(targets), *numbers)
    if status in (codes.BAD_INPUT, codes.BAD_SHAPE, codes.OUT_OF_RANGE):
        raise _failure(status, solver, np.vstack(rows), np.concatenate(targets), numbers)
    return solver.gains.copy(), solver.beta


def _check_lengths(name: str, jacobian: Array) -> None:
    """Refuse rows that are too long for floats: nothing would be certified, without a word.

    Raises:
        BadProblemError: the squared length of a finite row is not finite.
    """
    with np.errstate(over="ignore"):
        lengths = np.einsum("ij,ij->i", jacobian, jacobian)
    for row in np.flatnonzero(np.isinf(lengths)):
        longest = np.abs(jacobian[row]).max()
        if math.isfinite(longest):
            raise BadProblemError(
                f"{name}: the squared length of row {row} overflows (found entries up to "
                f"{longest:.3g}). Check the units."
            )


def _failure(
    status: int, solver: SdpGains, jacobian: Array, errors: Array, numbers: list[float]
) -> SolverError:
    if status == codes.OUT_OF_RANGE:
        return BadProblemError(f"{NAME}: the answer overflows. Check the units.")
    for name, value in zip(("dt", "beta_desired", "delta"), numbers, strict=True):
        if not (value > 0.0 and math.isfinite(value)):
            return BadProblemError(f"{name} must be positive and finite (found {value}).")
    outside = np.flatnonzero(~((solver.lower <= 0.0) & (solver.upper >= 0.0)))
    if outside.size:
        r = int(outside[0])
        return BadProblemError(
            f"joint {r} has speed limits [{solver.lower[r]}, {solver.upper[r]}]: they must allow "
            "to stand still."
        )
    named = "errors" if np.all(np.isfinite(jacobian)) else "jacobians"
    found = errors if named == "errors" else jacobian
    where = tuple(int(k) for k in np.argwhere(~np.isfinite(found))[0])
    return BadProblemError(f"{named}: a value is not finite (stacked, at {where}).")
