"""Generalized hierarchical control of several tasks (Liu, Tan and Padois, 2015)."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from hoap3.protocol.errors import located
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.acceleration.base import HierarchyController
from hoap3.remote_controller.controllers.acceleration.settings import RegularisedParameters
from hoap3.remote_controller.scheduling.priorities import Priorities, PrioritySettings, top_level
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.ghc.ghc import Ghc
from hoap3.remote_controller.tasks.registry import labels_of

MOST_LOGGED = 6  # tasks whose priorities are logged, k² columns


class RankedController(HierarchyController):
    """Tasks with priorities over each other."""

    class Parameters(RegularisedParameters):
        """Tasks, bounds and priorities."""

        priorities: PrioritySettings = Field(
            PrioritySettings(), description="of the tasks over each other"
        )

    importance: Priorities
    alpha: FloatArray
    """Priorities of the tasks and, last, of what brakes: below all that take part, (k + 1,)²."""

    def __init__(
        self, description: RobotDescription, parameters: Any, file: str = "config"
    ) -> None:
        super().__init__(description, parameters, file)
        self.alpha = np.zeros((len(self.tasks.names) + 1,) * 2)
        self.alpha[-1] = 0.0 if self._brakes else 1.0  # out of all, also itself: there is no such
        self.apply(parameters)

    @classmethod
    def importance_of(cls, parameters: Any) -> Priorities:
        """The priorities.

        Raises:
            ConfigError: they do not fit the tasks.
        """
        names = labels_of(parameters.tasks)
        with located("", "priorities"):
            return Priorities(names, parameters.priorities)

    @classmethod
    def columns(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        """Entries of the matrix of priorities, row by row; none of more than six tasks."""
        if len(names) > MOST_LOGGED:
            return ()
        return tuple(f"alpha_{a}_{b}" for a in names for b in names)

    def count(self, out: FloatArray) -> None:
        """Write the matrix."""
        alpha = self.importance.alpha
        if out.size:
            out[:] = alpha.ravel()
        tasks = self.tops.size
        self.alpha[:tasks, :tasks] = alpha
        if self._brakes:
            np.subtract(1.0, alpha.diagonal(), out=self.alpha[tasks, :tasks])
        self.tops[:] = top_level(alpha)
        self.absent[:] = alpha.diagonal()


class ProjectedParameters(RankedController.Parameters):
    """And how the generalized projector behaves."""

    smoothing: float = Field(
        0.0,
        ge=0,
        le=1,
        description="s₀ of the projector: levels whose singular values are below it fade out; "
        "0: the paper's",
    )


class GhcController(RankedController):
    """(13): every task has accelerations of its own, kept out of the directions of others.

        min Σ |J_i x_i − b_i|² + ω_r Σ |x_i|² + ω_r |τ − o|²
        such that τ = M ddq + h, ddq = Σ P_i x_i, lower ≤ ddq ≤ upper, |τ| ≤ torque_max,
        and what `constraints` ask for, G ddq ≤ h

    b_i is what task i asks for less its drift; the last task brakes, where no other speaks. Strict
    priorities are exact where `regularise` is `none`: elsewhere lower tasks shift what upper ones
    do by about ω_r. Where the tasks have an answer, and priorities rest, it allocates nothing;
    while they move, some hundred bytes a cycle.
    """

    class Parameters(ProjectedParameters):
        """And what ω_r weighs."""

        regularise: Literal["gravity_compensated", "torque", "none"] = Field(
            "gravity_compensated",
            description="what ω_r weighs beside the tasks' own accelerations: |τ − h|², |τ|² (the "
            "paper's, which gravity pulls on), or nothing",
        )

    proves = True
    kernels: ClassVar[tuple[str, ...]] = (
        *RankedController.kernels,
        "hoap3.remote_controller.solvers.ghc.ghc_kernels",
    )

    def __init__(
        self, description: RobotDescription, parameters: Parameters, file: str = "config"
    ) -> None:
        super().__init__(description, parameters, file)
        self.solver = Ghc(
            [*self.tasks.sizes, description.n],
            description.n,
            regularise=parameters.regularise if parameters.base == "fixed" else "none",
            smoothing=parameters.smoothing,
            rows=len(self.problem.rows),
        )
        self.answer_in(self.solver.qdd, self.solver.tau)

    def solve(self, torque_max: FloatArray) -> bool:
        """One compiled call."""
        solver, given = self.solver, self.problem
        solver.qdd_lower[:], solver.qdd_upper[:] = given.lower, given.upper
        if len(given.rows):
            solver.rows[:] = given.rows
            solver.rows_lower[:], solver.rows_upper[:] = given.rows_lower, given.rows_upper
        np.negative(torque_max, out=solver.tau_lower)
        solver.tau_upper[:] = torque_max
        found = solver.solve(*given.with_rest, self.alpha, given.mass, given.bias, self.w_r)
        self.residual = solver.kkt_residual
        return found == status.OK
