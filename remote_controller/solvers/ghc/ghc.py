"""Generalized hierarchical control: joint accelerations and torques for tasks with priorities.

Liu, Tan and Padois, Autonomous Robots 2015, (13): task i has its own joint acceleration x_i, and a
matrix of priorities says how much each is kept out of the directions of the others,

    min Σ |J_i x_i − b_i|² + ω_r Σ |x_i|² + ω_r |τ − o|²
    subject to  τ = M q̈ + h,   q̈ = Σ P_i x_i,   bounds of q̈ and τ,   rows of q̈.

The formulation, exact and of n unknowns however many tasks there are, stands in ``ghc_kernels``,
which are compiled, or loaded, when the first ``Ghc`` is made.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import BadProblemError, UnknownNameError
from hoap3.remote_controller.solvers.base.validation import KERNEL_ARRAYS, check_sizes, number

Array = NDArray[np.float64]

REGULARISED = {"none": 0, "torque": 1, "gravity_compensated": 2}


class Ghc:
    """Solves hierarchies of tasks for n joints without allocating anything.

    Args:
        sizes: number of rows of each task.
        n: number of joints.
        regularise: what ω_r weighs beside the x_i: "torque" is the paper's |τ|², which pulls on the
            tasks by what gravity takes; "gravity_compensated" is |τ − h|²; "none" is nothing, and
            strict priorities are exact only then: otherwise lower tasks shift what upper ones do by
            about ω_r.
        smoothing: s₀ of `projector_kernel`; 0 for the paper's projector. Beyond 1 this differs
            from that: a task whose Jacobian is I leaves nothing here, however large s₀ is.
        rows: s, number of rows rows_lower ≤ R q̈ ≤ rows_upper beside the bounds, (13c).

    Attributes:
        n: number of joints.
        tasks: number of tasks.
        offsets: where each task's rows begin in the stacked Jacobian, and their number.
        qdd_lower, qdd_upper, tau_lower, tau_upper: bounds, (n,), to be written to; ∓inf at first.
        rows: R, (s, n), to be written to; zeros at first. Their units do not matter.
        rows_lower, rows_upper: (s,), to be written to; ∓inf at first. Equal ones make an equation,
            which is kept to rounding; a row with ∓inf is off.
        qdd, tau: the answer, (n,); zeros where there is none.
        qdd_multipliers, tau_multipliers, rows_multipliers: of the bounds, (n,), and of the rows,
            (s,), positive where the upper one holds.
        active: number of bounds, rows and independent equations that hold the answer back.
        steps: of the active set; 0 where the free optimum satisfies the bounds.
        kkt_residual: how far the answer is from optimal by the conditions of the condensed problem,
            from its S and q₀, without the factors and the active set of the solver; relative,
            without units; inf where there is no answer. That S and q₀ are those of (13) it does not
            prove: tests do, against other solvers.

    Raises:
        BadProblemError: no task, a size or n that is not positive, or a negative number of rows.
        UnknownNameError: there is no such regularisation.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        n: int,
        *,
        regularise: str = "gravity_compensated",
        smoothing: float = 0.0,
        rows: int = 0,
    ) -> None:
        from hoap3.remote_controller.solvers.ghc import ghc_kernels

        if regularise not in REGULARISED:
            raise UnknownNameError("regularisation", regularise, REGULARISED)
        check_sizes("GHC", sizes, n)
        if rows < 0:
            raise BadProblemError(f"GHC: give it no rows or some (found {rows}).")
        m, k, c = sum(sizes), len(sizes), 2 * n + rows
        self.n, self.tasks, self.smoothing = n, k, number("smoothing", smoothing)
        self.offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self._kernel = ghc_kernels.ghc_kernel
        bounds = np.full((2, c), math.inf)
        bounds[0] = -math.inf
        self.qdd_lower, self.tau_lower, self.rows_lower = np.split(bounds[0], [n, 2 * n])
        self.qdd_upper, self.tau_upper, self.rows_upper = np.split(bounds[1], [n, 2 * n])
        self.rows = np.zeros((rows, n))
        numbers, integers = ghc_kernels.sizes_of(m, n, k, rows)
        out = np.zeros((2, c))
        scratch = np.empty(numbers), np.empty(integers, np.int64)
        mode = REGULARISED[regularise]
        self._same = mode, self.smoothing, self.rows, bounds, *scratch, out  # in every call
        self.qdd, self.tau, _ = np.split(out[0], [n, 2 * n])
        self.qdd_multipliers, self.tau_multipliers, self.rows_multipliers = np.split(
            out[1], [n, 2 * n]
        )
        self.active = self.steps = 0
        self.kkt_residual = math.inf

    def solve(
        self, jacobian: Array, targets: Array, alpha: Array, mass: Array, bias: Array, w_r: float
    ) -> int:
        """Find q̈ and τ.

        What is given must not be this solver's own answer: that is written while the rest is read.

        Args:
            jacobian: the tasks' rows, (m, n). Dependent and zero rows do no harm.
            targets: desired accelerations less drift, b, (m,).
            alpha: (k, k): alpha[i, j] from 0 to 1 is the priority of task j over task i; 1 keeps i
                out of j. alpha[i, i] fades task i out. Cycles are allowed.
            mass: M, (n, n), symmetric.
            bias: h, what gravity and motion take, (n,).
            w_r: ω_r ≥ 1e-8: its inverse stands beside the rest, and takes as many digits: at bounds
                the residual is some 10⁻¹⁶·|J|²/ω_r.

        Returns:
            `status.OK`; `INFEASIBLE`: no q̈ that the tasks span satisfies the bounds and rows, or a
            lower one is above the upper one; `UNSOLVED`: likewise, but ω_r is so small beside a
            task's |J|², 10⁻¹³ of it or less, that rounding may have hidden an answer; or the active
            set did not come to an end, which no problem is known to cause;
            `OUT_OF_RANGE`: numbers so large that the answer overflows; `BAD_INPUT`: a value is not
            finite or outside its range; `BAD_SHAPE`.

        Raises:
            BadProblemError: wrong type of array.
        """
        try:
            found, self.active, self.steps, self.kkt_residual = self._kernel(
                jacobian,
                self.offsets,
                targets,
                alpha,
                mass,
                bias,
                w_r,
                *self._same,
            )
        except TypeError as error:
            self.kkt_residual, self.active, self.steps = math.inf, 0, 0
            raise BadProblemError(f"GHC: wrong type of argument. {KERNEL_ARRAYS}") from error
        status: int = found
        return status
