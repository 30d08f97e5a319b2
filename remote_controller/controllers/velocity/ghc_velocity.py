"""Generalized hierarchical control of joint velocities: tasks with priorities that move."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.errors import located
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.velocity.velocity_task_stack import (
    LabelledTaskParameters,
    LabelledTasksController,
)
from hoap3.remote_controller.scheduling.priorities import Priorities, PrioritySettings, top_level
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.ghc.ghc import Ghc
from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction
from hoap3.remote_controller.tasks.registry import LabelledTask, labels_of

CERTIFIED_RESIDUAL = 1e-9
FIRST_ORDER = 0.01  # of V̇: by how much the fall of V over a period may differ from it
AT_TARGET = 1e-5  # of |e|: there V is too small for its derivative to tell [m or rad]
MOST_LOGGED = 6  # tasks whose priorities are logged, k² columns
FREE, BOUNDED = 0, 1  # solver_path
FALLBACKS = {status.OK: 0, status.INFEASIBLE: 1}
GAVE_UP = 2
_, INFEASIBLE, UNSOLVED, HELD, MOVING, IDLE = (1 << bit for bit in range(6))
CONDITIONS = (
    "state not finite",
    "no velocity within the bounds",
    "QP not solved",
    "held by bounds of joints",
    "priorities in transition",
    "no task takes part",
)


class RankedTask(LabelledTask):
    """A task that asks for a velocity of its own."""

    hints: ClassVar = dict.fromkeys(("kp", "kd"), "Velocities have one gain, gain_per_s [1/s]")

    gain_per_s: float = Field(
        5.0,
        gt=0,
        description="g of the wanted velocity −g·e − ∂e/∂t [1/s]",
        json_schema_extra=CHANGEABLE,
    )


class RankedParameters(LabelledTaskParameters):
    """Problem (13) for velocities, section 8."""

    tasks: tuple[RankedTask, ...] = Field(min_length=1, description="its tasks")
    priorities: PrioritySettings = Field(
        PrioritySettings(), description="which tasks keep which out; without any, none does"
    )
    regularisation: float = Field(
        1e-6,
        ge=1e-6,
        description="ω_r: how soon a task gives way near a singularity [m² or rad²]",
        json_schema_extra=CHANGEABLE,
    )
    smoothing: float = Field(
        0.0,
        ge=0,
        le=1,
        description="s₀: singular values from which on a direction is kept free in full; 0: all, "
        "however small, as the paper has it",
    )


class GhcVelocityController(LabelledTasksController):
    """Any number of tasks, each kept out of the others as far as `priorities` say.

        min Σ |J_i·x_i + g_i·e_i + ∂e_i/∂t|² + ω_r Σ |x_i|²
        such that u = Σ P_i(alpha)·x_i, lower ≤ u ≤ upper

    by Liu, Tan and Padois (2015), (13) with the velocities of section 8. The bounds are speed,
    acceleration, and stopping before the end of the range, so that the robot has nothing to hold
    back. Where no u that the tasks span is within them, or the solver gave up, each joint brakes as
    they allow, and `fallback` is 1, or 2.

    Time of the timeline begins with the reset, that is when the robot begins to follow.

    Certificate: V is the sum of those of the tasks that nothing is above, alpha_ij = 0 for all j;
    in a cycle without such a task, of all that take part. After a change of priorities it is about
    the new ones as soon as these rest. `v_rate_required` is 0: V shall not rise. `certified` says
    that the condensed QP was solved, by a residual ≤ 10⁻⁹, that priorities rest, and that V,
    evaluated where u leads, falls as V̇ says, to 1 %. `at_target` says the first two, and that these
    tasks are within 10⁻⁵ m or rad, where V is not told from what an Euler step of the tasks below
    makes of it. Nothing is claimed of tasks below, and where no task takes part nothing at all.
    `margin` is the least distance of u from a bound [rad/s or m/s].

    Raises:
        ConfigError: a task without an error, two of one name, or priorities that do not fit them.
    """

    Parameters: ClassVar[Any] = RankedParameters
    own_conditions = CONDITIONS
    importance: Priorities
    kernels = ("hoap3.remote_controller.solvers.ghc.ghc_kernels", *LabelledTasksController.kernels)

    def __init__(
        self, description: RobotDescription, parameters: RankedParameters, file: str = "config"
    ) -> None:
        self.importance = _priorities(parameters)
        super().__init__(description, parameters, file)
        n = description.n
        self._gains, self._wanted = np.zeros((2, sum(self.sizes)))
        self._solver = Ghc(self.sizes, n, regularise="none", smoothing=parameters.smoothing)
        self._mass, self._bias = np.eye(n), np.zeros(n)
        self._settled, self._settled_at = True, -1
        self._first = 0  # tick of the reset
        self._top: list[LyapunovFunction] = []
        self.not_certified_in |= MOVING | IDLE
        self._stale = True  # the top tasks are those of priorities that have moved since
        self.apply(parameters)

    @classmethod
    def check(cls, parameters: Any, file: str) -> None:
        """Refuse tasks and priorities that are wrong for any robot."""
        super().check(parameters, file)
        with located(file, "parameters"):
            _priorities(parameters)

    def columns(self) -> tuple[str, ...]:
        """Of few tasks alpha, row by row."""
        names = self.importance.names if len(self.importance.names) <= MOST_LOGGED else ()
        return tuple(f"alpha_{a}_{b}" for a in names for b in names)

    def judged(self) -> list[bool]:
        """The tasks that nothing is above."""
        return [function in self._top for function in self.functions]

    def apply(self, parameters: Any) -> None:
        """Read gains and ω_r as well."""
        super().apply(parameters)
        gains = [task.gain_per_s for task in parameters.tasks]
        self._gains[:], self._weight = np.repeat(gains, self.sizes), parameters.regularisation

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Begin anew, also with the timeline; the tasks do at the next State that is finite."""
        super().reset(state, last_command)
        self.importance.reset()
        self._first, self._settled_at = state.tick, -1
        self._top, self._stale = [], True

    def answer(self, state: State, base: FloatArray, now: float, noted: int) -> None:
        """Joint velocities, and their certificate."""
        command, solver, priorities = self.command, self._solver, self.importance
        if state.tick != self._settled_at:  # else it is asked again
            time_s = (state.tick - self._first) * self._dt
            self._settled = not (priorities.update(time_s) or priorities.moving)
        self._settled_at, settled = state.tick, self._settled
        self._stale = self._stale or not settled
        if (settled and self._stale) or not self._top:
            top = top_level(priorities.alpha).tolist()
            self._top = [task for task, is_top in zip(self.functions, top, strict=True) if is_top]
            self._stale = False
        if len(command.extra) > len(self.functions):
            command.extra[len(self.functions) :] = priorities.alpha.ravel()
        command.gains[:] = self._gains
        np.multiply(self._gains, self.errors, out=self._wanted)
        self._wanted += self.rates
        command.stamp_kinematics = self.now()
        solver.qdd_lower[:], solver.qdd_upper[:] = self.lower, self.upper
        found = solver.solve(
            self.jacobian, self._wanted, priorities.alpha, self._mass, self._bias, self._weight
        )
        # where there is no answer, as near to rest as the bounds allow
        command.margin = self._cut(
            solver.qdd, float(found == status.OK), self.lower, self.upper, self.u
        )
        self.present = (
            noted
            | (INFEASIBLE if found == status.INFEASIBLE else 0)
            | (UNSOLVED if found not in FALLBACKS else 0)
            | (HELD if solver.active else 0)
            | (0 if settled else MOVING)
            | (0 if self._top else IDLE)
        )
        self._certify(base, now, found, settled)

    def _certify(self, base: FloatArray, now: float, found: int, settled: bool) -> None:
        """Write what is proved of u."""
        command, solver = self.command, self._solver
        V = rate = 0.0
        for function in self._top:
            V += function.value
            rate += function.rate + float(function.gradient @ self.u)
        command.v, command.v_rate_predicted, command.v_rate_required = V, rate, 0.0
        command.fallback = FALLBACKS.get(found, GAVE_UP)
        command.solver_path = BOUNDED if solver.active else FREE
        if found != status.OK or not np.isfinite(V + rate):
            command.solver_status = STATUS["infeasible"]
            command.rho = command.kkt_residual = 0.0
            if not np.isfinite(V + rate):  # of a task that is not a number
                command.v = command.v_rate_predicted = 0.0
            return
        command.rho, command.kkt_residual = 1.0, solver.kkt_residual
        solved = settled and bool(self._top) and solver.kkt_residual <= CERTIFIED_RESIDUAL
        if solved and 2.0 * V <= AT_TARGET**2:
            command.solver_status = STATUS["at_target"]
            return
        proven = solved and rate < 0.0 and self._falls(base, now, V, rate)
        command.solver_status = STATUS["certified" if proven else "uncertified"]

    def _falls(self, base: FloatArray, now: float, V: float, rate: float) -> bool:
        """Whether V is less at the end of the period, by what V̇ says."""
        self._go_ahead(base)
        end = 0.0
        for function in self._top:
            function.update(self.kinematics, now + self._dt)
            end += function.value
        fall = (end - V) / self._dt
        return bool(end <= V and abs(fall - rate) <= FIRST_ORDER * abs(rate))


def _priorities(parameters: RankedParameters) -> Priorities:
    """Those of a config, whose tasks have names of their own."""
    names = labels_of(parameters.tasks)
    with located("", "priorities"):
        return Priorities(names, parameters.priorities)
