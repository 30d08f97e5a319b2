"""Closed-loop inverse kinematics of prioritised tasks, with constant gains or with a proof."""

from __future__ import annotations

import math
from abc import abstractmethod
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.velocity.velocity_task_stack import (
    LabelledTaskParameters,
    LabelledTasksController,
)
from hoap3.remote_controller.default_task import default_goal
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.clik.constant_gains import ConstantGains
from hoap3.remote_controller.solvers.sdp.sdp_gains import DELTA, SdpGains
from hoap3.remote_controller.tasks.registry import LabelledTask

AT_TARGET = 1e-5  # of |e|, all tasks [m or rad]
FIRST_ORDER = 0.01  # of β: by how much V may fall slower than the linear model has it
ACTIVE = 1e-9  # how near to a bound a velocity is held by it [rad/s or m/s]
MOST_LOGGED = 36  # rows whose gains are logged
FIGURES = ("beta", "beta_actual", "rank", "task_rank", "slack", "remainder", "floor")
FALLBACKS = {status.OK: 0, status.STATIONARY: 1}
GAVE_UP = 2
NO_CERTIFICATE, SPENT, UNSOLVED, HELD, TOO_FAST, FAR_FLOOR = (1 << bit for bit in range(1, 7))
CONDITIONS = (
    "state not finite",
    "no certificate",
    "budget spent",
    "gains not optimal",
    "held by limits",
    "target too fast",
    "floor above tolerance",
)
LITTLE = 0.1  # of β̃: with less than that V falls, but the lower tasks hardly arrive
LASTING_S = 0.1  # for which β is as little, before anybody is told
SLOW = "beta below a tenth of what was asked"


TASKS = "tasks, the most important first; null: the default task of the robot"


class WeightedTask(LabelledTask):
    """A task of V = ½ Σ w|e|²."""

    weight: float = Field(
        1.0,
        ge=1e-12,
        le=1e12,
        description="w of V = ½ Σ w|e|²; more for the upper tasks",
        json_schema_extra=CHANGEABLE,
    )


class SteadyTask(WeightedTask):
    """A task with a gain that stays as it is."""

    hints: ClassVar = dict.fromkeys(("kp", "kd"), "Velocities have one gain, gain_per_s [1/s]")

    gain_per_s: float = Field(
        1.0,
        gt=0,
        le=1e6,
        description="λ of all its rows [1/s]",
        json_schema_extra=CHANGEABLE,
    )


class ClikParameters(LabelledTaskParameters):
    """What both have."""

    tasks: tuple[WeightedTask, ...] | None = Field(None, min_length=1, description=TASKS)
    damping: float = Field(
        0.0,
        ge=0,
        le=1e6,
        description="d: Jᵀ(JJᵀ + d²I)⁻¹ stands for the pseudoinverse J⁺",
        json_schema_extra=CHANGEABLE,
    )
    floor_tolerance: float = Field(
        1e-4,
        gt=0,
        description="beside a moving target only what brings √(Σ w|e|²) below this is certified",
        json_schema_extra=CHANGEABLE,
    )


class SteadyParameters(ClikParameters):
    """Constant gains."""

    tasks: tuple[SteadyTask, ...] | None = Field(None, min_length=1, description=TASKS)


class SdpParameters(ClikParameters):
    """Gains by semidefinite programming."""

    beta_per_s: float = Field(
        4.0,
        gt=0,
        le=1e6,
        description="β̃: the rate at which V shall fall [1/s]",
        json_schema_extra=CHANGEABLE,
    )
    delta: float = Field(
        DELTA,
        ge=1e-12,
        le=1e3,
        description="δ: what large gains cost [1]",
        json_schema_extra=CHANGEABLE,
    )
    budget: int = Field(
        60,
        ge=1,
        le=1000,
        description="iterations that one cycle may take; then the last gains stay",
    )


def _with_default_task(parameters: Any, description: RobotDescription) -> Any:
    """The parameters with the robot's default task as their only one."""
    goal = default_goal(description, "tasks").settings
    content = {**parameters.model_dump(), "tasks": (goal.model_dump(),)}
    return type(parameters).model_validate(content)


class _Clik(LabelledTasksController):
    """dq = B(Λ e + L⁻¹ σ̇*), B = [J_1⁺ | N_1 J_2⁺ | …], L = J B: tasks in order of priority.

    By Marti-Saumell et al., (7), with feed-forward of moving targets: σ̇* is how far each goes in
    the next period, over T. The solver is given the bounds of velocities as limits, those of
    acceleration included. It can only take limits that allow to stand still: where a joint is too
    fast for that, 0 stands for the bound that forbids it, and if the answer is beyond the bound, u
    is cut to it. Nothing is certified then, nor where bounds are in the way of what is fed forward:
    `target too fast`. With damping σ̇* stands for L⁻¹ σ̇*, which would take the damping out.

    Certificate: V = ½ Σ w|e|² of all tasks falls by V⁺ ≤ (1 − β T) V, for targets that stand and
    by the linear model; `v_rate_required` is −β V. `certified` says that the solver is done, that
    β > 0, that u is exactly what the solver gave, and that V, evaluated where u leads, falls so
    fast, to 1 % of β: by `beta_actual`, (1 − V⁺/V)/T. `at_target` says the same without β, of tasks
    all within 10⁻⁵ m or rad.

    While a target moves, e⁺ = (I − T L Λ)e + ρ, and what is proved is √V⁺ ≤ √(1 − βT)·√V + r. The
    `remainder` r = √(½ Σ w|ρ|²) is evaluated where u and the targets lead, before u is sent: it is
    that of the model, not a bound of it. Of ρ the feed-forward leaves what is of second order in T.
    As long as r and β stay as they are, such steps bring √(Σ w|e|²) below any number above the
    `floor`, √2·r/(1 − √(1 − βT)); `certified` says besides that this is within `floor_tolerance`.
    `v_rate_required` is ((√(1 − βT)·√V + r)² − V)/T then, and `v_rate_predicted` (V⁺ − V)/T.

    `margin` is the least distance of u from a bound [rad/s or m/s]. `fallback` is 1 where no gains
    have a certificate, and 2 where the gains are not the optimal ones.

    Columns: `error_NAME`, |e| of each task; `beta`, `beta_actual` [1/s]; `rank` of the multiplier;
    `task_rank` of the stacked Jacobian; `slack` of the matrix inequality [1/s]; `remainder` and
    `floor`, 0 while targets stand, and a floor of −1 where there is none without β; and of up to
    36 rows `gain_NAME`, λ [1/s], with the number of the row if a task has more than one.
    """

    own_conditions: tuple[str, ...] = CONDITIONS
    solver: ConstantGains | SdpGains

    def __init__(
        self, description: RobotDescription, parameters: Any, file: str = "config"
    ) -> None:
        if parameters.tasks is None:
            parameters = _with_default_task(parameters, description)
        super().__init__(description, parameters, file)
        first = len(self.labels)
        self._errors_logged = slice(0, first)
        self._figures = slice(first, first + len(FIGURES))
        self._gains_logged = slice(first + len(FIGURES), len(self.extra_names))
        self._slices = [slice(*ends) for ends in pairwise(self.offsets.tolist())]
        self._moved = [  # rows of errors: a speed along a curve is the derivative of none
            (errors[: len(function.error)], rates[: len(function.error)])
            for function, (errors, rates, _) in zip(self.functions, self._rows, strict=True)
        ]
        self._shrunk, self._fed_back = np.zeros(len(self.errors)), np.zeros(description.n)
        self._has_gains = len(self.extra_names) > first + len(FIGURES)

    def apply(self, parameters: Any) -> None:
        """Read weights, damping and the floor as well."""
        super().apply(parameters)
        self._weights = [task.weight for task in parameters.tasks]
        self._row_weights = np.repeat(self._weights, self.sizes)
        self._floor_tolerance = parameters.floor_tolerance
        self.solver.weights[:], self.solver.damping = self._row_weights, parameters.damping

    def columns(self) -> tuple[str, ...]:
        """Figures of the certificate, and gains."""
        gains: list[str] = []
        for label, rows in zip(self.labels, self.sizes, strict=True):
            ends = [f"_{row}" for row in range(1, rows + 1)] if rows > 1 else [""]
            gains += [f"gain_{label}{end}" for end in ends]
        return (*FIGURES, *(gains if len(gains) <= MOST_LOGGED else ()))

    def judged(self) -> list[bool]:
        """The first task: the others move in its null space."""
        return [number == 0 for number in range(len(self.labels))]

    @abstractmethod
    def solve(self) -> tuple[int, int, float, float]:
        """Find gains for the stacked tasks within the limits.

        Returns:
            Path, rank of the multiplier, slack [1/s], and residual of the answer.
        """

    def answer(self, _: State, base: FloatArray, now: float, noted: int) -> None:
        """Joint velocities, and their certificate."""
        command, solver = self.command, self.solver
        np.minimum(self.lower, 0.0, out=solver.lower)
        np.maximum(self.upper, 0.0, out=solver.upper)
        moving = bool(self.rates.any())
        if moving:
            self._look_along(now)
        solver.rates[:] = self.rates
        command.stamp_kinematics = self.now()
        command.solver_path, rank, slack, command.kkt_residual = self.solve()
        found, beta = solver.status, solver.beta
        command.margin = self._cut(solver.dq, 1.0, self.lower, self.upper, self.u)
        command.fallback = FALLBACKS.get(found, GAVE_UP)
        within = not moving or self._fed_within()
        exact = found == status.OK and within and bool((self.u == solver.dq).all())
        if moving:
            actual, remainder, floor = self._certify_moving(base, now, exact)
        else:
            actual, remainder, floor = self._certify(base, now, exact), 0.0, 0.0
        self.present = (
            noted
            | (0 if beta > 0.0 else NO_CERTIFICATE)
            | (SPENT if found == status.ITERATION_LIMIT else 0)
            | (UNSOLVED if found not in FALLBACKS and found != status.ITERATION_LIMIT else 0)
            | (HELD if command.margin <= ACTIVE else 0)
            | (0 if within else TOO_FAST)
            | (FAR_FLOOR if exact and beta > 0.0 and floor > self._floor_tolerance else 0)
        )
        told = floor if floor < math.inf else -1.0
        figures = beta, actual, rank, solver.task_rank, slack, remainder, told
        command.extra[self._figures] = figures
        if self._has_gains:
            command.extra[self._gains_logged] = solver.gains
        command.gains[:] = solver.gains

    def _look_along(self, now: float) -> None:
        """Let `rates` be the mean ones of the next period, for the joints as they are."""
        for function, (errors, rates) in zip(self.functions, self._moved, strict=True):
            function.update(self.kinematics, now + self._dt)
            np.add(function.error, errors, out=rates)
            np.divide(rates, -self._dt, out=rates)

    def _fed_within(self) -> bool:
        """Whether the bounds allow all that is to be fed forward."""
        fed, solver = self.solver.fed, self.solver
        within = bool(((solver.lower <= fed) & (fed <= solver.upper)).all())
        return within and solver.fed_share == 1.0

    def _certify(self, base: FloatArray, now: float, exact: bool) -> float:
        """Write what is proved of u; returns the rate at which V falls in fact [1/s]."""
        command, beta = self.command, self.solver.beta
        V = rate = 0.0
        for weight, function in zip(self._weights, self.functions, strict=True):
            V += weight * function.value
            rate += weight * (function.rate + float(function.gradient @ self.u))
        end = self._value_ahead(base, now)
        if not np.isfinite(V + rate + end):  # of a task that is not a number
            return self._give_up()
        actual = (V - end) / (V * self._dt) if V > 0.0 else 0.0
        error = command.extra[self._errors_logged]
        arrived = exact and float(error @ error) <= AT_TARGET**2
        proven = exact and 0.0 < (1.0 - FIRST_ORDER) * beta <= actual
        command.v, command.v_rate_predicted = V, rate
        command.v_rate_required = 0.0 if arrived else -max(beta, 0.0) * V
        command.rho = 1.0 if exact else 0.0
        command.solver_status = STATUS[
            "at_target" if arrived else "certified" if proven else "uncertified"
        ]
        return actual

    def _certify_moving(
        self, base: FloatArray, now: float, exact: bool
    ) -> tuple[float, float, float]:
        """Write what is proved of u beside a target that moves.

        Returns:
            The rate at which V falls in fact [1/s], r, and the floor of √(Σ w|e|²).
        """
        command, solver, weights, T = self.command, self.solver, self._row_weights, self._dt
        V = 0.5 * float(weights @ (self.errors * self.errors))
        np.subtract(self.u, solver.fed, out=self._fed_back)
        np.dot(self.jacobian, self._fed_back, out=self._shrunk)
        self._shrunk *= -T
        self._shrunk += self.errors  # (I − T L Λ) e
        end = self._value_ahead(base, now)
        for function, rows in zip(self.functions, self._slices, strict=True):
            self._shrunk[rows] += function.followed[0]  # −ρ
        remainder = math.sqrt(0.5 * float(weights @ (self._shrunk * self._shrunk)))
        if not np.isfinite(V + end + remainder):
            return self._give_up(), 0.0, math.inf
        kept = math.sqrt(max(1.0 - max(solver.beta, 0.0) * T, 0.0))
        floor = math.sqrt(2.0) * remainder / (1.0 - kept) if kept < 1.0 else math.inf
        proven = exact and floor <= self._floor_tolerance
        command.v, command.v_rate_predicted = V, (end - V) / T
        command.v_rate_required = ((kept * math.sqrt(V) + remainder) ** 2 - V) / T
        command.rho = 1.0 if exact else 0.0
        command.solver_status = STATUS["certified" if proven else "uncertified"]
        return (V - end) / (V * T) if V > 0.0 else 0.0, remainder, floor

    def _value_ahead(self, base: FloatArray, now: float) -> float:
        """V at the end of the period, where u leads; the tasks' errors are those there."""
        self._go_ahead(base)
        end = 0.0
        for weight, function in zip(self._weights, self.functions, strict=True):
            function.update(self.kinematics, now + self._dt)
            end += weight * function.value
        return end

    def _give_up(self) -> float:
        """A task is not a number: nothing is proved."""
        command = self.command
        command.solver_status = STATUS["infeasible"]
        command.v = command.v_rate_predicted = command.v_rate_required = command.rho = 0.0
        return 0.0


class ClikController(_Clik):
    """Constant gains: dq = B(Λ e + L⁻¹ σ̇*), BΛe shortened where dq would leave its limits.

    β is λ_min(−A − Aᵀ − Δt AᵀA) of the gains as they are applied; one that is not positive
    certifies nothing, and is a condition, but the robot moves.
    """

    Parameters: ClassVar[Any] = SteadyParameters
    kernels = (
        "hoap3.remote_controller.solvers.clik.constant_gains_kernels",
        *LabelledTasksController.kernels,
    )
    solver: ConstantGains

    def __init__(
        self, description: RobotDescription, parameters: Any, file: str = "config"
    ) -> None:
        super().__init__(description, parameters, file)
        self.solver = ConstantGains(self.sizes, description.n, np.ones(len(self.errors)))
        self.apply(self.parameters)

    def apply(self, parameters: Any) -> None:
        """Read the gains as well."""
        super().apply(parameters)
        gains = [task.gain_per_s for task in parameters.tasks]
        self.solver.wanted[:] = np.repeat(gains, self.sizes)

    def solve(self) -> tuple[int, int, float, float]:
        """Apply the gains."""
        self.solver.solve(self.jacobian, self.errors, self._dt)
        return 0, 0, 0.0, 0.0


class ClikSdpController(_Clik):
    """Gains by semidefinite programming in each cycle, as large a β as the limits allow, up to β̃.

    Where no gains have a certificate, all are 0, and the robot does what moving targets feed
    forward, or keeps still. `kkt_residual` is the duality gap over β̃², at most 1; `solver_path` is
    0 none, 1 warm, 2 ipm, 3 budget.

    A further condition holds where β has been below a tenth of β̃ for 0.1 s, and the tasks have not
    arrived: V may be proved to fall, but the lower tasks will hardly arrive. Since β is 1/T at
    most, a β̃ beyond that counts as 1/T.
    """

    own_conditions = (*CONDITIONS, SLOW)

    Parameters: ClassVar[Any] = SdpParameters
    kernels = ("hoap3.remote_controller.solvers.sdp.sdp_kernels", *LabelledTasksController.kernels)
    solver: SdpGains

    def __init__(
        self, description: RobotDescription, parameters: Any, file: str = "config"
    ) -> None:
        super().__init__(description, parameters, file)
        from hoap3.remote_controller.solvers.sdp.sdp_kernels import FASTEST

        self._fastest_beta = FASTEST / description.period_s
        self._patience = round(LASTING_S / description.period_s)
        self._slow = self._slow_before = 0  # ticks, up to this one and the one before
        self._answered = -1
        self.solver = SdpGains(self.sizes, description.n, budget=parameters.budget)
        self.apply(self.parameters)

    def apply(self, parameters: Any) -> None:
        """Read β̃ and δ as well."""
        super().apply(parameters)
        self._desired = min(parameters.beta_per_s, self._fastest_beta)
        self._delta = parameters.delta
        self._little = LITTLE * min(self._desired, 1.0 / self._dt)

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Begin anew, also with the gains."""
        super().reset(state, last_command)
        self.solver.forget()
        self._slow, self._answered = 0, -1

    def answer(self, state: State, base: FloatArray, now: float, noted: int) -> None:
        """Joint velocities, their certificate, and whether β stays low."""
        super().answer(state, base, now, noted)
        arrived = self.command.solver_status == STATUS["at_target"]
        if state.tick != self._answered:  # else it is asked again
            self._slow_before, self._answered = self._slow, state.tick
        slow = self.solver.beta < self._little and not arrived
        self._slow = self._slow_before + 1 if slow else 0
        if self._slow > self._patience:
            self.present |= 1 << len(CONDITIONS)

    def solve(self) -> tuple[int, int, float, float]:
        """Find the gains."""
        solver = self.solver
        solver.solve(self.jacobian, self.errors, self._dt, self._desired, self._delta)
        gap = min(max(solver.gap / self._desired**2, 0.0), 1.0)
        return solver.path, solver.rank, solver.slack, gap
