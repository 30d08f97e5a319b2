"""`hqp`: strict priorities by a cascade of damped QPs (Liu, Tan and Padois, 2015, section 6).

Each level takes min |J (q̈ + Z z) − b|² + ω_r |z|² within bounds and torques, where Z spans what the
levels above leave. A task is below all that have a priority of more than ½ over it, and tasks in a
cycle share a level. Last, all joints brake by −d·q̇, d at most 1/T.

The steps Z z are found here by an oracle. They need not be trusted: the checker tests that each is
the only optimum of its level. How exactly their sum is known follows from the sensitivity of each
optimum, (z, λ) = K⁻¹ (Aᵀe, s) with the rows V z = s that hold it and their multipliers λ.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from hoap3.remote_controller.problems.acceleration import (
    OPTIMAL,
    TINY,
    AccelerationProblems,
    Optimum,
    Wish,
)
from hoap3.remote_controller.problems.acceleration_claims import RELATIVE, Cycle
from hoap3.remote_controller.problems.check import remaining, start_of
from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle as bounds
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import ROUNDING
from hoap3.remote_controller.problems.schedule import Priorities
from hoap3.remote_controller.problems.statement import Array, Cascade, Flags, Level, Rows
from hoap3.remote_controller.solvers.qp.reference import solve_qp

Settings = Mapping[str, Any]

DEFAULTS: dict[str, Any] = {
    "constraints": None,
    "bounds": bounds.HIERARCHY_DEFAULTS,
    "compensate_friction": True,
    "w_r": 0.01,
    "null_damping_per_s": 10.0,
    "priorities": {},
}
ABOVE = 0.5  # a task with more than this priority over another is a level above it
RANK = 1e-9  # of the largest singular value of a level's J: less is 0
SLACK = 1e-8  # of bounds below the first level
AT_LIMIT = 1e-6  # of a unit row: so near to a limit, it may hold the optimum
DEPENDENT = 1e-10  # of the largest singular value of K: less is rows that depend on each other
BRAKE_PER_S = 10.0  # of −q̇, the wish where the tasks have no answer even with strong motors


class Steps(NamedTuple):
    """Optima of the levels.

    Attributes:
        start: where the first begins, (n,).
        steps: Z z, (n,) each.
        sum_error: rounding error of their sum, (n,).
    """

    start: Array
    steps: tuple[Array, ...]
    sum_error: Array


class HqpProblems(AccelerationProblems):
    """The problems of `hqp`; arguments as of every `ProblemBuilder`."""

    defaults: ClassVar[Settings] = DEFAULTS
    proves: ClassVar[bool] = False
    in_rows: ClassVar[bool] = False

    def schedule(self, settings: Settings) -> Priorities:
        """Return the priorities."""
        return Priorities(self.names, settings["priorities"])

    def tops(self, importance: Array) -> Flags:
        """Return the tasks of the first level."""
        return first_level(importance)

    def optimum(self, cycle: Cycle) -> Optimum:
        """State the cascade within bounds and torques."""
        levels, b_errors = self._levels(cycle)
        limits, w = self._rows(cycle, self.torque_max), float(self.settings["w_r"])
        found = steps_of(levels, b_errors, w, *limits)
        none = np.zeros(len(cycle.dq))
        if found is None:  # no step keeps the rows; nor does the answer
            found = Steps(none, (cycle.ddq, *[none] * (len(levels) - 1)), none)
        span = max(TINY, float(np.abs(cycle.ddq).max()))
        error = OPTIMAL * span + found.sum_error
        problem = Cascade(levels, w, *limits, SLACK, RANK, found.steps, error)
        return Optimum(problem, cycle.ddq, cycle.ddq_error, 0.0)

    def wish(self, cycle: Cycle) -> Wish:
        """Return the cascade's answer with strong motors, or braking where it has none."""
        levels, b_errors = self._levels(cycle)
        limits = self._rows(cycle, np.full(len(cycle.dq), np.inf))
        found = steps_of(levels, b_errors, float(self.settings["w_r"]), *limits)
        one = np.eye(len(cycle.dq))
        if found is None:
            ddq = -BRAKE_PER_S * cycle.dq
            return Wish(one, ddq, ddq)
        ddq = found.start + np.sum(found.steps, 0)
        return Wish(one, ddq, ddq, float(found.sum_error.max()) / max(TINY, np.abs(ddq).max()))

    def _levels(self, cycle: Cycle) -> tuple[tuple[Level, ...], list[Array]]:
        """Return the levels, that of braking last, and the rounding error of each b."""
        d = min(self.settings["null_damping_per_s"], 1.0 / self.history.description.period_s)
        owner, J = np.repeat(np.arange(len(self.names)), np.diff(self.edges)), cycle.rows.jacobian
        masks = [np.isin(owner, level) for level in levels_of(cycle.importance)]
        levels = [Level(J[each], cycle.desired[each]) for each in masks]
        errors = [cycle.desired_error[each] for each in masks]
        brake = -d * cycle.dq
        levels.append(Level(np.eye(len(brake)), brake))
        return tuple(levels), [*errors, ROUNDING * np.abs(brake)]

    def _rows(self, cycle: Cycle, torque_max: Array) -> tuple[Rows, Rows]:
        """Return the limits of q̈, of τ and of constraints as rows of q̈, and equations."""
        A = np.vstack([np.eye(len(cycle.dq)), cycle.M])
        lower = np.concatenate([cycle.lower, -torque_max - cycle.h])
        upper = np.concatenate([cycle.upper, torque_max - cycle.h])
        size = np.concatenate([np.abs(cycle.ddq), np.abs(cycle.M) @ np.abs(cycle.ddq)])
        own = Rows.of(A, lower, upper, error=RELATIVE * (1.0 + size))
        parts: tuple[list[Rows], list[Rows]] = [own], [Rows.of(A[:0], 0.0, 0.0)]
        for rows in cycle.kept:
            parts[bool((rows.lower == rows.upper).all())].append(rows)
        return Rows.stacked(parts[0]), Rows.stacked(parts[1])


def steps_of(
    levels: Sequence[Level], b_errors: Sequence[Array], w: float, rows: Rows, equations: Rows
) -> Steps | None:
    """Return the steps of a cascade; None where a level has none within the rows.

    Args:
        levels: as of a `Cascade`.
        b_errors: of the b of each level, (m,).
        w: damping.
        rows, equations: that x keeps.
    """
    n = rows.A.shape[1]
    x, Z, error = start_of(equations)
    turned, slack = 0.0, 0.0
    computed = np.where(rows.A_error > 0.0, rows.error, 0.0)  # limits of constraints
    start, steps = x, list[Array]()
    for (J, b), b_error in zip(levels, b_errors, strict=True):
        if not Z.shape[1]:
            steps.append(np.zeros(n))
            continue
        A, missing, at = J @ Z, b - J @ x, rows.A @ x
        V, sides = rows.A @ Z, (rows.lower - slack - at, rows.upper + slack - at)
        z = _optimum(A, missing, w, V, *sides)
        if z is None:
            return None
        held, s_error = _held(V, z, *sides)
        s_error = s_error + computed + ROUNDING * (1.0 + np.abs(at)) + np.abs(rows.A) @ error
        gain, shift = _sensitivity(A, w, V[held])
        size = float(np.linalg.norm(J, 2))
        left, length = float(np.linalg.norm(missing - A @ z)), float(np.linalg.norm(z))
        bent = (ROUNDING + turned) * size * (left / w + length / math.sqrt(w))
        error = error + np.abs(Z @ gain) @ (b_error + np.abs(J) @ error)
        error += np.abs(Z @ shift) @ s_error[held] + bent + turned * length
        steps.append(Z @ z)
        x, (Z, least), slack = x + steps[-1], remaining(Z, J, RANK), SLACK
        turned += ROUNDING / least
    return Steps(start, tuple(steps), error)


def _optimum(A: Array, e: Array, w: float, V: Array, lower: Array, upper: Array) -> Array | None:
    """Return z of min |A z − e|² + w|z|² with lower ≤ V z ≤ upper; None where there is none."""
    H, f = A.T @ A + w * np.eye(A.shape[1]), A.T @ e
    z: Array = A.T @ np.linalg.solve(A @ A.T + w * np.eye(len(A)), e)
    values = V @ z
    near = ROUNDING * (1.0 + np.abs(values))
    if (values >= lower + near).all() and (values <= upper - near).all():
        return z
    length = np.linalg.norm(V, axis=1)
    kept = length > RANK
    sides = [each[kept] / length[kept] for each in (lower, upper)]
    return solve_qp(H, f, V[kept] / length[kept, None], *sides)


def _held(V: Array, z: Array, lower: Array, upper: Array) -> tuple[Flags, Array]:
    """Return which rows may hold z, and the rounding errors of all limits, (s,)."""
    values, length = V @ z, np.linalg.norm(V, axis=1)
    room = np.minimum(values - lower, upper - values)
    sizes = [np.where(np.isfinite(each), np.abs(each), 0.0) for each in (lower, upper)]
    return (room <= AT_LIMIT * length) & (length > RANK), ROUNDING * np.maximum(*sizes)


def _sensitivity(A: Array, w: float, V: Array) -> tuple[Array, Array]:
    """Return ∂z/∂e and ∂z/∂s of min |A z − e|² + w|z|² with V z = s."""
    N, length = A.shape[1], np.linalg.norm(V, axis=1)
    unit, corner = V / length[:, None], np.zeros((len(V), len(V)))
    K = np.block([[A.T @ A + w * np.eye(N), unit.T], [unit, corner]])
    inverse = np.linalg.pinv(K, DEPENDENT, hermitian=True)
    return inverse[:N, :N] @ A.T, inverse[:N, N:] / length


def first_level(alpha: Array) -> Flags:
    """Return which tasks are of the highest level, (k,), from priorities (k, k)."""
    first = [each for level in levels_of(alpha)[:1] for each in level]
    return np.isin(np.arange(len(alpha)), first)


def levels_of(alpha: Array) -> list[list[int]]:
    """Return the active tasks by level, highest first, from priorities (k, k)."""
    active = alpha.diagonal() <= ABOVE
    above = (alpha > ABOVE) & ~np.eye(len(alpha), dtype=bool) & active[:, None] & active
    for _ in range(len(alpha)):  # what is above a task above is above
        above |= above @ above
    left, levels = np.flatnonzero(active).tolist(), []
    while left:
        level = [i for i in left if all(above[j, i] for j in left if above[i, j])]
        levels.append(level)
        left = [i for i in left if i not in level]
    return levels
