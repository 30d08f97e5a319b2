"""The problems of each controller whose base is free, in the unknowns y of `free_base`.

The optimum of `hqp` is not stated.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from hoap3.remote_controller.problems import tsid, weighted
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
from hoap3.remote_controller.problems.hqp import first_level
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import ROUNDING
from hoap3.remote_controller.problems.schedule import Priorities, Schedule, Weights, top_tasks
from hoap3.remote_controller.problems.statement import Array, Flags, Program, Rows
from hoap3.remote_controller.problems.tsid import TasksOfTsid

REST_OF_FREE = 1e-2  # of the posture's weight: that of what neither tasks nor posture determine


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

    defaults: ClassVar[Settings] = weighted.DEFAULTS
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
        scale = weighted.roots(cycle.importance, self.edges)
        n = len(y)
        R = np.vstack([scale[:, None] * tasks.J, np.sqrt(w) * np.eye(n)])
        r = np.concatenate([scale * tasks.b, np.sqrt(w) * (brake.J.T @ brake.b)])
        away = np.abs(brake.J.T) @ brake.b_error
        r_error = np.concatenate([scale * tasks.b_error, np.sqrt(w) * away])
        H = R.T @ R
        inverse, stiff = np.linalg.inv(H), H.diagonal()
        span = max(TINY, float(np.abs(y).max()), float((np.abs(R.T @ r) / stiff).max()))
        r_error = r_error + ROUNDING * np.abs(r)
        exact = float((np.abs(R.T) @ r_error / stiff).max()) / span
        error = np.abs(inverse @ R.T) @ r_error
        error += np.abs(inverse) @ stiff * span * (unknowns.residual + ROUNDING)
        return Program.of(R, r, rows, error), exact


class TsidFreeProblems(TasksOfTsid, WeightedFreeProblems):
    """The problems of `tsid`: the posture is the last task, and the joints do not brake."""

    defaults: ClassVar[Settings] = {**tsid.DEFAULTS, "null_damping_per_s": 0.0}
    proves: ClassVar[bool] = True

    def entries(self, settings: Settings) -> list[Settings]:
        """Return the tasks and the posture."""
        if not settings["tasks"]:
            raise UnverifiableError("the goal of tsid with a free base is not recomputed")
        return super().entries(settings)

    def weight(self, importance: Array) -> float:
        """Return the weight of what neither tasks nor posture determine."""
        return REST_OF_FREE * max(float(importance[-1]), tsid.LEAST_WEIGHT)


class HqpFreeProblems(GhcFreeProblems):
    """`hqp`: everything but the optimum of its levels."""

    proves: ClassVar[bool] = False
    stated: ClassVar[bool] = False

    def tops(self, importance: Array) -> Flags:
        """Return the tasks of the highest level: below nothing that is not below them."""
        return first_level(importance)
