"""The problems of each controller whose base is free, in the unknowns y of `free_base`.

The optimum of `hqp` is not stated.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from hoap3.remote_controller.problems.acceleration import OPTIMAL, TINY, Settings
from hoap3.remote_controller.problems.acceleration_claims import Cycle
from hoap3.remote_controller.problems.free_base import (
    FreeBaseProblems,
    Task,
    Unknowns,
    shifted_rows,
)
from hoap3.remote_controller.problems.ghc import (
    DEFAULTS,
    SMALLEST,
    Wanted,
    condensed,
    roots_of,
    with_braking,
)
from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle as bounds
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import ROUNDING
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import posture_of
from hoap3.remote_controller.problems.schedule import Priorities, Schedule, Weights, top_tasks
from hoap3.remote_controller.problems.statement import Array, Flags, Program, Rows

HALF = 0.5  # a greater priority makes a task stand above another
REST, LEAST_WEIGHT, REST_OF_FREE = "rest", 1e-9, 1e-2  # of tsid: the posture, and its weights
TSID_DEFAULTS: dict[str, Any] = {
    "tasks": None,
    "constraints": None,
    "bounds": bounds.HIERARCHY_DEFAULTS,
    "compensate_friction": True,
    "null_damping_per_s": 0.0,
    "posture": {"kp": 10.0, "kd": None, "posture": None, "posture_rad": (), "weight": 1e-3},
    "priorities": {"weights": None, "timeline": None},
}


class GhcFreeProblems(FreeBaseProblems):
    """The problems of `ghc`: (13) of Liu, Tan and Padois in y, without |τ − o|²."""

    defaults: ClassVar[Settings] = DEFAULTS

    def schedule(self, settings: Settings) -> Schedule:
        """Return the priorities."""
        return Priorities(self.names, settings["priorities"])

    def tops(self, importance: Array) -> Flags:
        """Return the tasks without any above."""
        return top_tasks(importance)

    def program(
        self, cycle: Cycle, unknowns: Unknowns, tasks: Task, rows: Rows
    ) -> tuple[Program, float]:
        """State (13) as `ghc` does, with the joints' braking as the last task."""
        y, settings = unknowns.y, self.settings
        brake = self.braking(cycle, unknowns.reduced)
        J, b, b_error = (np.concatenate(each) for each in zip(tasks, brake, strict=True))
        wanted = Wanted(J, b, b_error + ROUNDING * np.abs(b), [*self.edges, len(b)])
        whole = with_braking(cycle.importance, brakes=settings["null_damping_per_s"] > 0.0)
        found = condensed(wanted, whole, float(settings["w_r"]), float(settings["smoothing"]))
        V, length = roots_of(found.S)
        span = max(SMALLEST, float(np.abs(y).max()), float(np.abs(found.q0).max()))
        exact = float(found.q0_error.max()) / span
        limits = shifted_rows(rows.A @ V, rows.A @ found.q0, rows.lower, rows.upper, rows.error)
        none, error = np.zeros(len(length)), np.full(len(y), span * (OPTIMAL + exact))
        z = V.T @ (y - found.q0)
        R = np.diag(1.0 / length)
        return Program(R, none, none, none, limits, V, found.q0, error, z), exact


class WeightedFreeProblems(FreeBaseProblems):
    """The problems of `weighted`: min Σ ω_i |J_i y − b_i|² + ω_r |y − p|².

    p is y of the joints' braking, projected by the orthonormal basis.
    """

    defaults: ClassVar[Settings] = DEFAULTS
    proves: ClassVar[bool] = False

    def schedule(self, settings: Settings) -> Schedule:
        """Return the weights."""
        return Weights(self.names, settings["priorities"])

    def tops(self, importance: Array) -> Flags:
        """Return the tasks with weight."""
        return importance > 0.0

    def weight(self, importance: Array) -> float:
        """Return ω_r."""
        del importance
        return float(self.settings["w_r"])

    def program(
        self, cycle: Cycle, unknowns: Unknowns, tasks: Task, rows: Rows
    ) -> tuple[Program, float]:
        """State the weighted problem."""
        y, w = unknowns.y, self.weight(cycle.importance)
        brake = self.braking(cycle, unknowns.reduced)
        roots = np.sqrt(np.repeat(cycle.importance, np.diff(self.edges)))
        n = len(y)
        R = np.vstack([roots[:, None] * tasks.J, np.sqrt(w) * np.eye(n)])
        r = np.concatenate([roots * tasks.b, np.sqrt(w) * (brake.J.T @ brake.b)])
        away = np.abs(brake.J.T) @ brake.b_error
        r_error = np.concatenate([roots * tasks.b_error, np.sqrt(w) * away])
        H = R.T @ R
        inverse, stiff = np.linalg.inv(H), H.diagonal()
        span = max(TINY, float(np.abs(y).max()), float((np.abs(R.T @ r) / stiff).max()))
        r_error = r_error + ROUNDING * np.abs(r)
        exact = float((np.abs(R.T) @ r_error / stiff).max()) / span
        error = np.abs(inverse @ R.T) @ r_error
        error += np.abs(inverse) @ stiff * span * (unknowns.residual + ROUNDING)
        return Program.of(R, r, rows, error), exact


class TsidFreeProblems(WeightedFreeProblems):
    """The problems of `tsid`: the posture is the last task, and the joints do not brake."""

    defaults: ClassVar[Settings] = TSID_DEFAULTS
    proves: ClassVar[bool] = True

    def entries(self, settings: Settings) -> list[Settings]:
        """Return the tasks and the posture."""
        if not settings["tasks"]:
            raise UnverifiableError("the goal of tsid with a free base is not recomputed")
        description, rest = self.history.description, settings["posture"]
        target = posture_of(description, rest["posture"], rest["posture_rad"]).tolist()
        gains = {"kp": rest["kp"], "kd": rest["kd"]}
        posture = {"name": REST, "task": "posture", "parameters": {"target_rad": target}, **gains}
        return [*settings["tasks"], posture]

    def schedule(self, settings: Settings) -> Schedule:
        """Return the weights, that of the posture last."""
        given = settings["priorities"]
        weights = {**(given["weights"] or {}), REST: settings["posture"]["weight"]}
        return Weights(self.names, {**given, "weights": weights})

    def tops(self, importance: Array) -> Flags:
        """Return the tasks with weight, without the posture."""
        tops = importance > 0.0
        tops[-1] = False
        return tops

    def weight(self, importance: Array) -> float:
        """Return the weight of what neither tasks nor posture determine."""
        return REST_OF_FREE * max(float(importance[-1]), LEAST_WEIGHT)


class HqpFreeProblems(GhcFreeProblems):
    """`hqp`: everything but the optimum of its levels."""

    proves: ClassVar[bool] = False
    stated: ClassVar[bool] = False

    def tops(self, importance: Array) -> Flags:
        """Return the tasks of the highest level: below nothing that is not below them."""
        return highest_level(importance)


def highest_level(alpha: Array) -> Flags:
    """Return which active tasks are above every task that is above them, (k,).

    A priority of more than ½ makes a task stand above another, and above all below that.
    """
    part = alpha.diagonal() <= HALF
    below = (alpha > HALF) & ~np.eye(len(alpha), dtype=bool) & np.outer(part, part)
    for _ in alpha:
        below |= (below.astype(int) @ below.astype(int)) > 0
    return np.asarray(part & (below <= below.T).all(1))
