"""`weighted`: tasks with weights share one acceleration (Liu, Tan and Padois, 2015, (12)).

min Σ ω_i |J_i q̈ − b_i|² + ω_r |q̈ + d·q̇|² + ω_r |τ − o|² within bounds and torques; o is h, or 0.
"""

from __future__ import annotations

from abc import abstractmethod
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
from hoap3.remote_controller.problems.acceleration_claims import RELATIVE, Cycle, rounding_of
from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle as bounds
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import ROUNDING
from hoap3.remote_controller.problems.schedule import Weights
from hoap3.remote_controller.problems.statement import Array, Flags, Program, Rows
from hoap3.remote_controller.solvers.qp.reference import solve_qp

Settings = Mapping[str, Any]

DEFAULTS: dict[str, Any] = {
    "constraints": None,
    "bounds": bounds.HIERARCHY_DEFAULTS,
    "compensate_friction": True,
    "w_r": 0.01,
    "null_damping_per_s": 10.0,
    "regularise": "gravity_compensated",
    "priorities": {},
}
BRAKE_PER_S = 10.0  # of −q̇, the wish where the tasks have no answer even with strong motors


class LeastSquares(NamedTuple):
    """min ½|R q̈ − r|², R (s, n) and r (s,), and the rounding error of r, (s,)."""

    R: Array
    r: Array
    r_error: Array

    def error(self) -> Array:
        """Return the rounding error of the optimum, (n,), without that of R."""
        H = self.R.T @ self.R
        return np.asarray(np.abs(np.linalg.inv(H)) @ (np.abs(self.R).T @ self.r_error))


def roots(weights: Array, edges: Sequence[int]) -> Array:
    """Return √ω of each row, (m,); a negative weight of a wrong log counts as 0."""
    return np.asarray(np.sqrt(np.repeat(np.maximum(weights, 0.0), np.diff(edges))))


class WeighedProblems(AccelerationProblems):
    """The problems of a controller whose tasks have weights, a least-squares problem in q̈."""

    def schedule(self, settings: Settings) -> Weights:
        """Return the weights."""
        return Weights(self.names, settings["priorities"])

    def tops(self, importance: Array) -> Flags:
        """Return the tasks with weight."""
        return importance > 0.0

    @abstractmethod
    def cost(self, cycle: Cycle) -> LeastSquares:
        """Return what an answer minimises."""

    def optimum(self, cycle: Cycle) -> Optimum:
        """State the least squares within bounds and torques.

        A residual is what the gradient would move a joint by, g_i/H_ii, relative to the largest
        acceleration, or to what the tasks would move one joint alone by.
        """
        cost = self.cost(cycle)
        R, r, r_error = cost
        stiff, pull = (R**2).sum(0), np.abs(R.T @ r)
        span = max(TINY, float(np.abs(cycle.ddq).max()), float((pull / stiff).max()))
        exact = float((np.abs(R).T @ r_error / stiff + cycle.ddq_error).max()) / span
        exact += float((cycle.tau_error / self.torque_max).max())
        error = span * OPTIMAL + cost.error()
        limits = self._limits(cycle, cycle.ddq_error + RELATIVE * (1.0 + np.abs(cycle.ddq)))
        rows = Rows.stacked([limits, self._torque_rows(cycle)])
        return Optimum(Program.of(R, r, rows, error), cycle.ddq, cycle.ddq_error, exact)


class WeightedProblems(WeighedProblems):
    """The problems of `weighted`; arguments as of every `ProblemBuilder`."""

    defaults: ClassVar[Settings] = DEFAULTS
    proves: ClassVar[bool] = False

    def cost(self, cycle: Cycle) -> LeastSquares:
        """Return (12), with braking by at most 1/T."""
        settings, M, n = self.settings, cycle.M, len(cycle.dq)
        damping = min(settings["null_damping_per_s"], 1.0 / self.history.description.period_s)
        braking = -damping * cycle.dq
        R, r = [cycle.rows.jacobian, np.eye(n)], [cycle.desired, braking]
        r_error = [cycle.desired_error, ROUNDING * np.abs(braking)]
        if settings["regularise"] != "none":
            R.append(M)
            r.append(-cycle.h if settings["regularise"] == "torque" else np.zeros(n))
            r_error.append(np.full(n, rounding_of(M, cycle.h, cycle.dq, cycle.ddq)))
        scale = np.full(sum(map(len, r)), np.sqrt(settings["w_r"]))
        scale[: len(cycle.desired)] = roots(cycle.importance, self.edges)
        return LeastSquares(
            scale[:, None] * np.vstack(R),
            scale * np.concatenate(r),
            scale * np.concatenate(r_error),
        )

    def wish(self, cycle: Cycle) -> Wish:
        """Return the optimum within the bounds with strong motors, or braking without one."""
        R, r, _ = self.cost(cycle)
        one, H, limits = np.eye(len(cycle.dq)), R.T @ R, self._limits(cycle, 0.0)
        ddq = solve_qp(H, R.T @ r, limits.A, limits.lower, limits.upper)
        if ddq is None:
            braking = -BRAKE_PER_S * cycle.dq
            return Wish(one, braking, braking)
        condition = float(np.linalg.cond(H))
        return Wish(one, ddq, ddq, ROUNDING * condition, np.sqrt(condition))
