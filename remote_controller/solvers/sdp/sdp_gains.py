"""Gains of prioritised tasks with a proof that the errors fall.

Marti-Saumell, Santamaria-Navarro, Ocampo-Martinez and Andrade-Cetto, "Multi-task closed-loop
inverse kinematics stability through semidefinite programming": the tasks' errors e are brought down
by dq = B Λ e, B = [J_1⁺ | N_1 J_2⁺ | …], and the gains λ on the diagonal of Λ solve

    min (β − β̃)² + δ|λ|²   subject to   V⁺ ≤ (1 − β Δt) V,   lower ≤ dq ≤ upper

where V = ½ Σ w_i e_i² and V⁺ is its value a step later by the linear model e⁺ = (I − Δt L Λ) e,
L = [J_1; …; J_h] B. The condition on V is a matrix inequality (`lmi_kernels`), so a semidefinite
program results: n + 1 unknowns, one n × n matrix.

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
from numpy.typing import NDArray

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.base import status as codes
from hoap3.remote_controller.solvers.base.validation import KERNEL_ARRAYS, check_sizes

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
        budget: iterations that one solve may take.

    Attributes:
        weights: w of V, (n,), positive, to be written to; 1 at first. Weighting the upper tasks
            more lets hierarchies with many rows converge much faster; the certificate is that of
            the V that is weighted.
        damping: d ≥ 0, to be set; 0 at first: J_iᵀ(J_i J_iᵀ + d²I)⁻¹ stands for J_i⁺. L is that of
            the damped law, so the certificate covers it.
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
        BadProblemError: no task, one without rows, or no joint.
    """

    def __init__(self, sizes: Sequence[int], joints: int, *, budget: int = 60) -> None:
        from hoap3.remote_controller.solvers.sdp import memory_kernels as memory
        from hoap3.remote_controller.solvers.sdp import sdp_kernels

        check_sizes(NAME, sizes, joints)
        n = self.n = sum(sizes)
        self.joints, self.budget, self.damping = joints, budget, 0.0
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
        self.weights[:], self.lower[:], self.upper[:] = 1.0, -math.inf, math.inf
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
