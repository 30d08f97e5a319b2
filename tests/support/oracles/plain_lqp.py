"""Oracle of generalized hierarchical control: one large quadratic program, as it is printed.

Liu, Tan and Padois, Autonomous Robots 2015, (13): slower than `ghc` by the number of tasks to its
third power, and with everything that the paper allows:

    min Σ |J_i x_i − b_i|² + ω_r Σ |x_i|² + ω_r |χ − o|²
    subject to  M q̈ + n = J_cᵀ w_c + Sᵀ τ,   G [q̈; χ] ≤ h,   q̈ = Σ P_i x_i,   χ = [w_c; τ].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError, InfeasibleError, SolverError, UnknownNameError
from hoap3.remote_controller.solvers.base.validation import array, number
from hoap3.remote_controller.solvers.ghc.ghc import REGULARISED

from ..solvers.one_shot import generalized_projector
from ..solvers.task_stacks import Stack, fit, limits_of, stacked

Array = NDArray[np.float64]

TOLERANCE = 1e-10  # of the constraints
EQUATION, SOLVED, CONTRADICTORY = 5, 1, -1  # daqp's words


@dataclass(frozen=True)
class Motion:
    """An answer.

    Attributes:
        qdd: q̈, (n,).
        tau: τ, (n_a,).
        wrench: w_c, (c,), of the environment on the robot.
    """

    qdd: Array
    tau: Array
    wrench: Array


class PlainLqp:
    """The program (13) of one robot: what it can do, without its tasks.

    Args:
        n: number of joints, actuated or not.
        S: selection matrix, (n_a, n): torques act as Sᵀτ; the identity by default.
        contact: Jacobian of all contact forces, (c, n); none by default.
        G, h: rows G [q̈; w_c; τ] ≤ h, (r, n + c + n_a) and (r,): obstacles and limits of joints as
            accelerations, bounds of wrenches, friction cones.

    Raises:
        BadProblemError: wrong shape, or a value that is not finite.
    """

    def __init__(
        self,
        n: int,
        *,
        S: ArrayLike | None = None,
        contact: ArrayLike | None = None,
        G: ArrayLike | None = None,
        h: ArrayLike | None = None,
    ) -> None:
        self.n, self.full = n, S is None and contact is None
        self.S = np.eye(n) if S is None else array("S", S, 2)
        self.contact = np.zeros((0, n)) if contact is None else array("contact", contact, 2)
        fit("S", self.S, (self.S.shape[0], n))
        fit("contact", self.contact, (self.contact.shape[0], n))
        width = n + self.contact.shape[0] + self.S.shape[0]
        self.G = np.zeros((0, width)) if G is None else array("G", G, 2)
        self.h = np.zeros(0) if h is None else array("h", h, 1)
        fit("G", self.G, (self.h.size, width))
        fit("h", self.h, (self.h.size,))

    def solve(
        self,
        tasks: Stack,
        alpha: ArrayLike,
        w_r: float,
        regularise: str = "gravity_compensated",
        smoothing: float = 0.0,
    ) -> Motion:
        """Find q̈ and χ.

        Args:
            tasks: what `stacked` makes of them.
            alpha: priorities, (k, k).
            w_r: ω_r, positive.
            regularise: as for `Ghc`: "none" only where all joints have torques and nothing
                touches.
            smoothing: s₀ of `generalized_projector`.

        Raises:
            InfeasibleError: nothing satisfies the constraints.
            BadProblemError: wrong shape, or a value outside its range.
            SolverError: daqp gave up.
        """
        import daqp

        H, f, rows, least, most, motion, still = self.program(
            tasks, array("alpha", alpha, 2), number("w_r", w_r), regularise, smoothing
        )
        free = np.full(f.size, 1e30)
        sense = np.concatenate([np.zeros(f.size), np.where(least == most, EQUATION, 0)])
        x, _, flag, _ = daqp.solve(
            H,
            f,
            np.ascontiguousarray(rows),
            np.concatenate([free, most]),
            np.concatenate([-free, least]),
            sense.astype(np.int32),
            primal_tol=TOLERANCE,
        )
        if flag == CONTRADICTORY:
            raise InfeasibleError("LQP: no acceleration and action satisfy all constraints.")
        if flag != SOLVED:
            raise SolverError(f"LQP: daqp gave up with {flag}.")
        found = motion @ x + still
        qdd, wrench, tau = np.split(found, [self.n, self.n + self.contact.shape[0]])
        return Motion(qdd, tau, wrench)

    def program(
        self, tasks: Stack, alpha: Array, w: float, regularise: str, smoothing: float
    ) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
        """The arrays of (13): min ½ xᵀHx + fᵀx, least ≤ rows·x ≤ most; [q̈; χ] = motion·x + still.

        Where nothing is regularised, τ = M q̈ + n is put in, so that no unknown is without weight.
        """
        n, k, actions = self.n, len(tasks.sizes), self.G.shape[1] - self.n
        if tasks.n != n:
            raise BadProblemError(f"the tasks have {tasks.n} joints, the robot {n}.")
        if regularise not in REGULARISED:
            raise UnknownNameError("regularisation", regularise, REGULARISED)
        if regularise == "none" and not self.full:
            raise BadProblemError('"none" needs a torque at every joint, and no contact.')
        if not 0.0 < w < math.inf:
            raise BadProblemError(f"w_r must be positive and finite (found {w}).")
        fit("alpha", alpha, (k, k))
        P = np.hstack(
            [
                generalized_projector(
                    np.repeat(row, tasks.sizes), tasks.jacobian, smoothing=smoothing
                )
                for row in alpha
            ]
        )
        size = n * k + (0 if regularise == "none" else actions)
        H, f = w * np.eye(size), np.zeros(size)
        edges = np.cumsum([0, *tasks.sizes])
        for i in range(k):
            J, own = tasks.jacobian[edges[i] : edges[i + 1]], slice(i * n, i * n + n)
            H[own, own] += J.T @ J
            f[own] = -J.T @ tasks.targets[edges[i] : edges[i + 1]]
        motion, still = np.zeros((n + actions, size)), np.zeros(n + actions)
        motion[:n, : n * k] = P
        least, most = np.full(self.h.size, -1e30), self.h - self.G @ still
        if regularise == "none":
            motion[n:], still[n:] = tasks.mass @ P, tasks.bias
            return H, f, self.G @ motion, least, self.h - self.G @ still, motion, still
        motion[n:, n * k :] = np.eye(actions)
        if regularise == "gravity_compensated":
            f[size - self.S.shape[0] :] = -w * (self.S @ tasks.bias)
        acting = np.hstack([self.contact.T, self.S.T])
        balance = np.hstack([tasks.mass @ P, -acting])
        rows = np.vstack([balance, self.G @ motion])
        least, most = np.concatenate([-tasks.bias, least]), np.concatenate([-tasks.bias, most])
        return H, f, rows, least, most, motion, still


def lqp(
    jacobians: Sequence[ArrayLike],
    targets: Sequence[ArrayLike],
    alpha: ArrayLike,
    M: ArrayLike,
    bias: ArrayLike,
    w_r: float,
    *,
    regularise: str = "gravity_compensated",
    **limits: ArrayLike,
) -> tuple[Array, Array]:
    """As `ghc`, arguments, errors and answers alike, by the program (13) as it is printed.

    Raises:
        InfeasibleError, BadProblemError, UnknownNameError: as `ghc`.
        SolverError: daqp gave up.
    """
    stack = stacked(jacobians, targets, M, bias)
    ql, qu, tl, tu, *_ = limits_of(stack.n, **limits)
    sides = np.vstack([np.eye(2 * stack.n), -np.eye(2 * stack.n)])
    h = np.concatenate([qu, tu, -ql, -tl])
    given = np.isfinite(h)
    found = PlainLqp(stack.n, G=sides[given], h=h[given]).solve(stack, alpha, w_r, regularise)
    return found.qdd, found.tau


def projected_sum(
    inputs: ArrayLike, jacobians: Sequence[ArrayLike], alpha: ArrayLike, *, smoothing: float = 0.0
) -> NDArray[np.float64]:
    """Σ P_i u_i: what tasks ask of the joints, velocities, accelerations or torques (section 8).

    Torques keep a strict level from being accelerated if J M⁻¹ stands for its Jacobian here.

    Args:
        inputs: u_i of each task, (k, n).
        jacobians: J_i of each, (m_i, n).
        alpha: priorities, (k, k); alpha[i, j] is that of task j over task i.
        smoothing: as for `generalized_projector`.

    Returns:
        (n,).

    Raises:
        BadProblemError: as `generalized_projector`, or the numbers of tasks or joints differ.
    """
    wanted, priorities = array("inputs", inputs, 2), array("alpha", alpha, 2)
    rows = [array(f"jacobians[{i}]", J, 2) for i, J in enumerate(jacobians)]
    k, n = wanted.shape
    if len(rows) != k or priorities.shape != (k, k) or {J.shape[1] for J in rows} != {n}:
        raise BadProblemError(
            f"{k} inputs of {n} joints need {k} Jacobians of {n} columns, and alpha of shape "
            f"({k}, {k}); found {len(rows)} Jacobians, and alpha of shape {priorities.shape}."
        )
    if not np.isfinite(wanted).all():
        raise BadProblemError("inputs must be finite.")
    sizes, stack, total = [len(J) for J in rows], np.vstack(rows), np.zeros(n)
    for row, each in zip(priorities, wanted, strict=True):
        total += generalized_projector(np.repeat(row, sizes), stack, smoothing=smoothing) @ each
    return total
