"""Problem (3) of `stable_qp`: min Φ(u) with V̇ = −ρΨ within constraints.

Gonçalves et al., IEEE T-RO 2020, sections II and III. V = ½|e|² of the task, ∇V = Jᵀe.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.history import ProblemBuilder
from hoap3.remote_controller.problems.oracles.constraints.base_oracle import Bounds, Constraint
from hoap3.remote_controller.problems.oracles.constraints.cycles_oracle import Cycles
from hoap3.remote_controller.problems.oracles.constraints.stack_oracle import constraints_of
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import default_entry, task_of
from hoap3.remote_controller.problems.oracles.tasks.curve_oracle import CURVES, Curve
from hoap3.remote_controller.problems.oracles.tasks.task_oracle import AnyTask
from hoap3.remote_controller.problems.oracles.tasks.task_oracle import Rows as TaskRows
from hoap3.remote_controller.problems.stable_qp_cycle import Cycle
from hoap3.remote_controller.problems.stable_qp_objective import Objective
from hoap3.remote_controller.problems.stable_qp_settings import Settings
from hoap3.remote_controller.problems.statement import Claim, Statement
from hoap3.remote_controller.problems.velocity_answer import DELAYED, VelocityAnswer

COLUMNS = "psi", "drift", "solver_status"


class StableQpProblems(ProblemBuilder):
    """The problems of `stable_qp`; arguments as of every `ProblemBuilder`.

    Attributes:
        settings, objective: in force.
        task, constraints: of these.
        task_rows: error, Jacobian and rate of the task at the newest State.
        limits: the rows of each constraint that has some, there.
        bounds: of u, (1 or 2, n); the last row is that of the newest State.
        columns: where Ψ, ∂V/∂t and the solver's status are in `extra`.
    """

    checks_every_answer: ClassVar[bool] = True

    def __init__(
        self,
        description: RobotDescription,
        parameters: Mapping[str, Any],
        session: Mapping[str, Any],
        controller: str = "stable_qp",
    ) -> None:
        super().__init__(description, parameters, session, controller)
        names = list(session.get("extra") or ())
        if any(name not in names for name in COLUMNS):
            raise UnverifiableError("the log does not name psi, drift and solver_status")
        self.columns = [names.index(name) for name in COLUMNS]
        self._robot = Robot(description, self.history.messages)
        self.settings = Settings.of(parameters)
        if self._delayed and self.settings.rest["kinematics_from"] == "reference":
            raise UnverifiableError(DELAYED)
        self.task = self._task_of(self.settings)
        self.constraints, self._unknown = self._constraints_of(self.settings)
        self.objective = self._objective_of(self.settings)
        self.task_rows: TaskRows
        self.bounds: Bounds
        self.limits: list[tuple[Constraint, Any]] = []

    def adopt(self, parameters: Mapping[str, Any]) -> None:
        """Take other parameters; what tasks and constraints remember stays."""
        settings, before = Settings.of(parameters), self.settings
        if settings.task != before.task:
            task, old = self._task_of(settings), self.task
            task.take_over(old)
            self.task = task
        if settings.constraints != before.constraints:
            constraints, self._unknown = self._constraints_of(settings)
            if self.history.first is not None:
                self._begin_constraints(constraints)
                for new, last in zip(constraints, self.constraints, strict=True):
                    new.take_over(last)
            self.constraints = constraints
        self.settings, self.objective = settings, self._objective_of(settings)

    def begin(self) -> None:
        """Start the task and the constraints from the newest State."""
        self._start(self.task)
        self._begin_constraints(self.constraints)

    @property
    def has_memory(self) -> bool:
        """Whether tolerances, a curve's tangent or a constraint depend on the States before."""
        remembers = any(constraint.has_memory for constraint in self.constraints)
        return remembers or self.task.watched or isinstance(self.task, Curve)

    def observe(self) -> None:
        """Evaluate what has memory: tolerances, tangents of curves, rows of constraints."""
        state, time_s = self.history.state, self.history.time_s
        if self.task.watched:
            self._robot.place(state["q"])
            self.task.watch(self._robot, time_s)
        self._robot.place(state[self._kinematics_from])
        self.task_rows = self.task.at(self._robot, time_s)
        window, cycles = self._window()
        n, count = self.history.description.n, len(window)
        self.bounds = Bounds(np.full((count, n), -np.inf), np.full((count, n), np.inf))
        for each in sorted(self.constraints, key=lambda each: not each.limits_speed):
            each.bound(window, cycles, self.bounds)
        self.limits = [
            (each, each.rows(state, count - 1)) for each in self.constraints if each.has_rows
        ]

    def derivative_claims(self) -> list[Claim]:
        """Claims of the derivatives of a user's task and of users' constraints."""
        claims = [] if isinstance(self.task, Curve) else self.task.derivative_claims(self._robot)
        return claims + [each for limit in self.constraints for each in limit.derivative_claims()]

    def state_problem(self, setpoint: Any) -> Statement:
        """Everything that the certificate claims of an answer."""
        T = self.history.description.period_s
        answer = VelocityAnswer.of(self.history.state, setpoint, self.settings.rest, T)
        cycle = Cycle(self, setpoint, answer, self.task_rows)
        claims = cycle.claims_of_v()
        unverified = tuple(("constraint " + name, why) for name, why in self._unknown.items())
        if self._delayed:
            return cycle.statement(claims, (), (*unverified, ("u", DELAYED)))
        claims += [*answer.claims(), *cycle.claims_of_speed()]
        if self._unknown:
            return cycle.statement(claims, (), unverified)
        claims += [*cycle.claims_of_margin(), *cycle.claims_of_optimum()]
        return cycle.statement(claims, cycle.problems(), cycle.unverified())

    @property
    def _delayed(self) -> bool:
        return self.history.description.delay_ticks > 0

    @property
    def _kinematics_from(self) -> str:
        measured = self.settings.rest["kinematics_from"] != "reference"
        return "q" if measured else "reference"

    def _start(self, task: AnyTask | Curve) -> None:
        first = self.history.first
        self._robot.place(first[self._kinematics_from])
        task.begin(self._robot, int(first["tick"]) * self.history.description.period_s)

    def _begin_constraints(self, constraints: Sequence[Constraint]) -> None:
        first = self.history.first
        self._robot.place(first[self._kinematics_from])
        for constraint in constraints:
            if constraint.has_rows:
                constraint.begin(first)

    def _window(self) -> tuple[Any, Cycles]:
        """The newest State, behind the one of the period before where that is known."""
        history, state, before = self.history, self.history.state, self.history.before
        window = np.array([state] if before is None else [before, state], state.dtype)
        passed = 0 if before is None else history.periods_between(before, state)
        fresh = np.array([True, False])[: len(window)]
        numbers = np.arange(len(window))
        return window, Cycles(numbers, numbers, fresh, np.array([0, passed])[: len(window)])

    def _task_of(self, settings: Settings) -> AnyTask | Curve:
        entry = settings.task or default_entry(self.history.description)
        return Curve(entry, self._robot) if entry["task"] in CURVES else task_of(entry, self._robot)

    def _constraints_of(self, settings: Settings) -> tuple[list[Constraint], dict[str, str]]:
        return constraints_of(settings.constraints, self._robot)

    def _objective_of(self, settings: Settings) -> Objective:
        constrained = bool(settings.constraints) or isinstance(self.task, Curve)
        names = self.history.description.joint_names
        try:
            return Objective.of(settings.objective, names, constrained=constrained)
        except (TypeError, ValueError) as error:
            raise UnverifiableError(f"objective: {error!s:.80}") from error
