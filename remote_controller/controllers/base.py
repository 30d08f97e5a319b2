"""What every controller is: built from a description and its parameters, reset, stepped."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import BadProblemError, ConfigError, DescriptionError, UsageError
from hoap3.protocol.messages import COMMANDS, FloatArray, Setpoint, State
from hoap3.protocol.robot.description import CommandKind, RobotDescription
from hoap3.protocol.robot.urdf import first_twice
from hoap3.remote_controller.controllers import certificate
from hoap3.remote_controller.controllers.in_flight import InFlight
from hoap3.remote_controller.controllers.jerk_judge import judge_of
from hoap3.remote_controller.controllers.progress import Progress
from hoap3.remote_controller.controllers.singularity import LEAVING, SingularityExit
from hoap3.remote_controller.references.live.live import Live
from hoap3.remote_controller.scheduling.changes import FILE, Changes, Part, private
from hoap3.remote_controller.scheduling.schedule import Schedule
from hoap3.remote_controller.tasks.accuracy import TaskError
from hoap3.remote_controller.tasks.registry import FollowedTask

if TYPE_CHECKING:
    from hoap3.remote_controller.problems import ProblemBuilder

STATUS = certificate.STATUS
"""Setpoint.solver_status by name: certified, at_target, uncertified, infeasible, none."""

CERTIFIED_RESIDUAL = 1e-9  # greatest kkt_residual of an answer that counts as the optimum
VIOLATED = "tolerance of a trajectory violated"
"""The condition of controllers with tasks that have tolerances; the last of their conditions."""
HELD_BACK = "a change is held back"
"""The condition of controllers of velocities in ticks at which numbers that move may not."""
ROUNDING = 1e-9  # of a jump of velocities
SLOW_PER_S = 1e-3  # of V: a controller by which it falls no faster stands still
OVER_S = 0.5  # how long changed numbers take, where nobody says
ACTIVE_SPEED = 1e-3  # rad/s: below it a joint counts as inactive (QP12, section V-C)


def bits(conditions: Sequence[str]) -> tuple[int, ...]:
    """The bit of each condition in `Controller.present`, in their order."""
    return tuple(1 << place for place in range(len(conditions)))


def agreed(commands: Sequence[CommandKind], description: RobotDescription) -> CommandKind:
    """What a controller shall give, of what it can, to a robot: the first that this takes.

    Raises:
        DescriptionError: the robot takes nothing of it.
    """
    for kind in description.command_kinds:
        if kind in commands:
            return kind
    raise DescriptionError(
        f"{mismatch(commands, description)}. If the robot can take that, too, start it so: "
        f"`hoap3 emulator … --set command={commands[0]}`, or with `run` "
        f"--set emulator.command={commands[0]}. Else choose another controller, or another robot"
    )


def mismatch(commands: Sequence[CommandKind], description: RobotDescription) -> str:
    """That a controller gives nothing that a robot takes, in words."""
    takes, gives = " or ".join(description.command_kinds), " or ".join(commands)
    return f"robot {description.name!r} takes {takes}, and the controller gives {gives}"


def _delayed(description: RobotDescription, why: str) -> DescriptionError:
    name, delay = description.name, description.delay_ticks
    return DescriptionError(
        f"robot {name!r} applies each answer {delay} ticks later, and {why}. Give the emulator "
        "delay_ticks: 0, or take a controller of velocities that integrates from the reference"
    )


class Controller(ABC):
    """Answers each State with a Setpoint.

    A subclass names its settings in a nested `Parameters` model and its additional log columns
    in `extra_names`, writes into `self.command` and returns it. Where the columns, or `arrays`,
    depend on the parameters, it sets them before it calls this `__init__`. Nothing may be
    allocated in `step` that can be allocated in `__init__`.

    Args:
        description: of the robot.
        parameters: a `Parameters` of this class.

    Attributes:
        command: the answer; its certificate says what was proved of it.
        now: clock of the loop [ns]; for stamps only, never for control.
        kind: what its commands are, one of `commands`.
        conditions: names of what may hold in a cycle and people should know.
        present: which of them hold in this cycle: bit i for `conditions[i]`. Where one begins or
            ends, the log says so.
        certifies: whether it can certify answers at all, with its solver and configuration.
        not_certified_in: conditions, by bit, in which there is nothing that a certificate could
            claim: priorities are in transition, or no task takes part. Their answers count as
            not certifiable; where these are too many, the task is not judged.
        progress: finds tasks that are stationary or blocked; None for a controller that does not.
        too_fast: bit of the condition that its law is too fast for the robot's servos, where
            nothing is certified; 0 where it is slow enough. See `servo_rate`.
        live: its targets that somebody steers, in the order in which messages count them.
        margin_tolerance: how far the certificate's `margin` may be below 0 by rounding, in its
            unit; None for a controller without constraints.
        importance: priorities or weights of its tasks, which change by requests of their own.
        parts: parameters of its tasks and constraints, for live changes of their numbers.
        fixed: keys of its own numbers that are declared changeable, but have no effect here.
    """

    class Parameters(Settings):
        """Settings that every controller has."""

        change_over_s: float = Field(
            OVER_S,
            ge=0,
            le=3600,
            description="duration of the way of numbers that are changed while it runs, where the "
            "change gives none [s]",
        )

    extra_names: tuple[str, ...] = ()
    arrays: Mapping[str, int] = MappingProxyType({})
    """Lengths of `decision`, `slacks`, `gains` and `next` of its commands, where it writes them."""
    commands: ClassVar[tuple[CommandKind, ...]] = ("position",)
    """What it can give; the robot's description decides which of these its `command` is."""
    follows_delay: ClassVar[bool] = False
    """Whether it reckons with a robot that applies its answers `delay_ticks` later."""
    importance: Schedule | None = None
    fixed: frozenset[str] = frozenset()
    kernels: ClassVar[tuple[str, ...]] = ()
    """Modules that compile what it needs; a service has them ready before anything else."""
    problem_type: ClassVar[type[ProblemBuilder] | None] = None
    """What `hoap3 verify` checks its answers with; without it they are not verified."""

    def __init__(self, description: RobotDescription, parameters: Settings) -> None:
        self.conditions: tuple[str, ...] = ()
        self.present = 0
        self.certifies, self.not_certified_in = True, 0
        self.too_fast = 0
        self.progress: Progress | None = None
        self.live: Sequence[Live] = ()
        self.margin_tolerance: float | None = None
        self.parts: list[Part] = []
        self.description, self.parameters = description, parameters
        self._changes: Changes | None = None
        self.now: Callable[[], int] = time.monotonic_ns
        twice = first_twice(self.extra_names)
        if twice is not None:
            remedy = "Rename a task, or a column of the controller"
            raise ConfigError("", "", twice, "two columns of the log have this name", remedy)
        self.command = Setpoint(description.n, len(self.extra_names), **self.arrays)
        self.command.solver_status = STATUS["none"]
        self.kind = agreed(self.commands, description)
        if description.delay_ticks and not self.follows_delay:
            raise _delayed(description, f"{type(self).__name__} reckons without a delay")
        self.command.command = COMMANDS[self.kind]

    @classmethod
    def configured(cls, description: RobotDescription, parameters: Any, file: str) -> Self:
        """One for a robot; whoever names other files or parts in its parameters builds them here.

        Args:
            description: of the robot.
            parameters: a `Parameters` of this class.
            file: where they stand, for errors. Other files are sought beside it.
        """
        del file
        return cls(description, parameters)

    @classmethod  # noqa: B027 - most have nothing to add
    def check(cls, parameters: Any, file: str) -> None:
        """Refuse what `Parameters` cannot see to be wrong, and what needs no robot to be so.

        Raises:
            ConfigError, UnknownNameError: naming the file, the key and the value.
        """

    @abstractmethod
    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Begin at `state`, so that the next command does not jump.

        Args:
            state: the newest one; its `reference` is what the robot applies.
            last_command: the last values sent to the robot, (n,), or None.
        """

    @abstractmethod
    def step(self, state: State) -> Setpoint:
        """Answer `state`; returns `self.command` with `values` and the certificate filled in."""

    def margin_of(self) -> tuple[str, str]:
        """What the `margin` of the last answer is of, and its unit; "" for what is not known."""
        return "", ""

    def refuse(self, present: int) -> Setpoint:
        """Answer with nothing to follow, as where a State is not finite.

        Args:
            present: bits of the `conditions` that say why; 0 for none.
        """
        command, self.present = self.command, present
        command.values[:] = np.nan
        command.v = command.v_rate_required = command.v_rate_predicted = command.rho = 0.0
        command.margin = command.kkt_residual = 0.0
        command.extra[:] = command.slacks[:] = command.gains[:] = 0.0
        command.decision[:] = command.next[:] = np.nan
        command.active_joints = command.solver_path = command.fallback = 0
        command.solver_status = STATUS["infeasible"]
        return command

    def judge(self, *, solved: bool, at_target: bool, proven: bool) -> None:
        """Write what the certificate proves: infeasible, at_target, certified or uncertified.

        Args:
            solved: whether there is an answer.
            at_target: whether it is that nothing is left to do.
            proven: whether all that the certificate claims is shown to hold.
        """
        proven = proven and not self.too_fast
        verdict = "at_target" if at_target else "certified" if proven else "uncertified"
        self.command.solver_status = STATUS[verdict if solved else "infeasible"]

    def heed_servos(self, condition: str) -> None:
        """Certify nothing where the law is too fast for the robot's servos.

        Args:
            condition: why, as `servo_rate.too_fast` says; "" where it is not.
        """
        if condition:
            self.too_fast = 1 << len(self.conditions)
            self.conditions = (*self.conditions, condition)

    def watch_progress(
        self,
        tasks: Sequence[FollowedTask],
        bounds: tuple[FloatArray, FloatArray],
        constraints: Sequence[str] = (),
        ends: FloatArray | None = None,
    ) -> Progress:
        """Add the conditions of stationary and blocked tasks; arguments as of `Progress`."""
        given = tasks, bounds, constraints, ends
        self.progress = Progress(self.description, self.conditions, *given)
        self.conditions = self.progress.names
        return self.progress

    def restart_progress(self) -> None:
        """Forget for how long tasks have been blocked."""
        if self.progress is not None:
            self.progress.reset()

    def notes(self) -> list[str]:
        """What people should know of it at the start, a line each."""
        if not self.too_fast:
            return []
        why = self.conditions[self.too_fast.bit_length() - 1]
        remedy = "Slow the law, damp the servos, or write kinematics_from: reference"
        return [f"no answer will be certified: {why} (`hoap3 help plants`). {remedy}"]

    def task_errors(self) -> list[TaskError]:
        """Errors of the tasks at the last `step`, each with its tolerance; empty without a target.

        Called outside the loop, when the robot stops following; it must not change anything.
        """
        return []

    @property
    def is_stationary(self) -> bool:
        """Whether a task is stationary in this cycle: nothing is certified then."""
        return self.progress is not None and bool(self.present & self.progress.stationary)

    def explained(self, error: TaskError, task: str) -> TaskError:
        """Return an error of the named task, with the reason why it does not fall if known."""
        if self.progress is None:
            return error
        return replace(error, reason=self.progress.reason_of(error, task))

    def change(self, request: Mapping[str, Any]) -> None:
        """Apply a request for other numbers, or other priorities: all of it, or nothing.

        Called between two steps. The log has each accepted request, so a replay repeats it.

        Args:
            request: numbers that are declared changeable, by their keys as in the config, nested
                or with dots, tasks by their names; or a change of `importance`; and `over_s`, how
                long it takes [s].

        Raises:
            UsageError: it is refused; says what is wrong with it and what is not.
        """
        self.begin_changes()
        changes, importance = self._ready_for_changes(), self.importance
        if importance is not None and importance.is_asked(request):
            importance.check_alone(request, changes.shown())
            importance.change(request, importance.time_s)
            return
        if not changes.numbers:
            raise UsageError(f"controller {type(self).__name__} takes no changes while it runs")
        changes.request(request)

    def changeable(self) -> dict[str, Any]:
        """What `change` can change, as it is now: a JSON object, empty where nothing can."""
        found, importance = self._ready_for_changes().shown(), self.importance
        return found if importance is None else {**found, importance.key: importance.shown()}

    def numbers(self) -> list[dict[str, Any]]:
        """Key, meaning and bounds of each number that `change` can change."""
        return self._ready_for_changes().described()

    def apply(self, parameters: Any) -> None:  # noqa: B027 - some read `self.parameters` instead
        """Read the parameters that may change into the running controller.

        Called with requested parameters to check them, then with the present ones again, and with
        those of each step of a transition: it assigns, and allocates as little as possible. What it
        accepts is an interval of each number, so that all values on the way are accepted.

        Raises:
            ConfigError: they do not fit the robot; with file "" and the key inside the parameters.
        """

    def validate(self, parameters: Any) -> None:
        """Refuse requested parameters that do not fit: what takes too long to check in each step.

        Raises:
            ConfigError: with file "" and the key inside the parameters.
        """
        self.check(parameters, FILE)

    def begin_changes(self) -> None:
        """Make ready for changes: called once it is built, or by the first change."""
        self._ready_for_changes()

    def advance(self, state: State) -> None:
        """Move changed numbers to the tick of a State: the first thing that `step` does."""
        if self._changes is not None and self._changes.moving:
            self._changes.advance(state.tick)
            self._changes.keep()

    def forget_changes(self) -> None:
        """Have the numbers of the config again: whoever begins anew does."""
        if self._changes is not None:
            self._changes.reset()

    def _ready_for_changes(self) -> Changes:
        if self._changes is None:
            self.parameters = private(self.parameters)
            over_s = getattr(self.parameters, "change_over_s", OVER_S)
            own = Part((), (), self.parameters, self.apply, self.fixed)
            self._changes = Changes([own, *self.parts], self.validate, over_s, self.description)
            self._changes.rehearse()
        return self._changes


class VelocityController(Controller):
    """A controller that finds joint velocities u; setpoints are their Euler integral.

    q*_{k+1} = a_k + u_k·T, where a_k is the reference that the robot applies (footnote 11 of
    the QP12 paper has the measured position there; `integrate_from: measured` does that, and
    stalls on coarse encoders).

    A robot with `delay_ticks` d applies the answer to tick k at tick k + 1 + d. There `velocity` is
    given a State whose `reference` is foreseen for tick k + d, when only this answer is still to
    come; all else in it is as it was published. Where the robot applies something else than was
    foreseen, that answer is not certified either.

    Where the robot would hold a joint back at a limit of position, speed, acceleration or jerk,
    nothing is certified, whatever `velocity` said. How fast the reference moves is known from two
    States in a row, and where the robot begins to follow: it is at rest then. After a State that
    was missed one answer is not certified, because nobody knows whether the robot can do it; three,
    where a limit of jerk counts.
    """

    follows_delay = True

    class Parameters(Controller.Parameters):
        """Settings that every velocity controller has."""

        integrate_from: Literal["measured", "reference"] = Field(
            "reference", description="joint positions that setpoints are integrated from"
        )
        change_jump_rad_s: float | None = Field(
            None,
            gt=0,
            description="most by which a change alone may alter a velocity in one period; null: "
            "what joints brake with in one [rad/s or m/s]",
        )

    def __init__(self, description: RobotDescription, parameters: Settings) -> None:
        from hoap3.remote_controller.model import kinematics_kernels as kernels

        self.arrays = {"decision": description.n, **self.arrays}
        super().__init__(description, parameters)
        self._euler_step = kernels.euler_step
        self._histories = kernels.AT_REST, kernels.FOLLOWED, kernels.UNKNOWN
        self._dt = description.period_s
        self._limits = np.array(
            [
                description.lower,
                description.upper,
                description.velocity,
                description.setpoint_acceleration_max,
            ]
        )
        self._ends, self._fastest = self._limits[:2], self._limits[2]
        self._jerk = judge_of(description)
        self._no_velocity = np.full(description.n, np.nan)
        jump: float | None = getattr(parameters, "change_jump_rad_s", None)
        self._jump = (1.0 + ROUNDING) * (jump or description.brake_acceleration * self._dt)
        self._held_back = 0  # bit of the condition
        self._exit: SingularityExit | None = None
        self._leaving = 0  # bit of the condition
        self._candidate = np.zeros(description.n)
        self._earlier = np.zeros(description.n)  # reference
        self._periods = -1  # of the last State
        self._from_reference = getattr(parameters, "kinematics_from", "measured") == "reference"
        self._from_measured = getattr(parameters, "integrate_from", "reference") == "measured"
        self._flight = InFlight(description) if description.delay_ticks else None
        if self._flight is not None and self._from_measured:
            raise _delayed(description, "integrate_from: measured starts from a position of before")

    @abstractmethod
    def velocity(self, state: State) -> FloatArray:
        """Joint velocities u for `state`, (n,) [rad/s or m/s], in wire order, contiguous."""

    def gradient_at(self, q: FloatArray, time_s: float) -> FloatArray:
        """Evaluate the tasks at joint positions; return ∇V of those that must be reached, (n,)."""
        raise NotImplementedError

    def leave_singularities(self, parameters: Any) -> None:
        """Leave stationary points if the parameters ask for it; call it after `watch_progress`."""
        if parameters.leave_singularity and self.progress is not None:
            self._exit = SingularityExit(self.description, self.progress.bounds, self.gradient_at)
            self._leaving = 1 << len(self.conditions)
            self.conditions = (*self.conditions, LEAVING)
            self.not_certified_in |= self._leaving

    def refuse_velocity(self, present: int) -> FloatArray:
        """`refuse`, for `velocity` to return: velocities that are no numbers, (n,)."""
        self.refuse(present)
        return self._no_velocity

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Nothing to remember: every setpoint starts from the robot's applied reference."""
        del state, last_command
        self.forget_changes()
        self.restart_progress()
        if self._exit is not None:
            self._exit.reset()

    def step(self, state: State) -> Setpoint:
        """Integrate `velocity` over one period.

        Raises:
            BadProblemError: it is no array of float64 with as many values as the robot has joints.
        """
        command, flight = self.command, self._flight
        command.stamp_kinematics = self.now()
        if flight is not None:
            state = flight.ahead(state)
        changes = self._changes
        self.present &= ~self._held_back
        moving = changes is not None and changes.moving
        u = self._changing(changes, state) if changes and moving else self.velocity(state)
        self.present |= self.too_fast
        u = u if self._exit is None else self._leave(self._exit, state, u)
        start = state.q if self._from_measured else state.reference
        history = self._history(state)
        if flight is not None and not flight.foreseen:
            history = self._histories[2]
        try:
            active, beyond = self._euler_step(
                start,
                u,
                self._dt,
                ACTIVE_SPEED,
                history,
                state.reference,
                self._limits,
                self._earlier,
                command.values,
            )
        except TypeError as error:
            name = type(self).__name__
            raise BadProblemError(
                f"{name}.velocity gave {u!r:.60}, not a contiguous array of float64"
            ) from error
        if active < 0:
            name, n = type(self).__name__, self.description.n
            raise BadProblemError(f"{name}.velocity gave {u.size} values for {n} joints")
        command.active_joints = active
        if command.decision.size:  # a command of somebody's own may be without
            command.decision[:] = u
        if self._jerk is not None:
            at_rest, followed, _ = self._histories
            beyond += self._jerk.holds_back(
                command.values,
                state.reference,
                at_rest=history == at_rest,
                followed=history == followed,
            )
        status = command.solver_status
        if beyond and (status == STATUS["certified"] or (active and status == STATUS["at_target"])):
            command.solver_status = STATUS["uncertified"]
        if flight is not None:
            flight.sent(state.tick, command.values)
        return command

    def begin_changes(self) -> None:
        """Make ready, with a condition that holds where a change is held back."""
        if self._ready_for_changes().numbers and not self._held_back:
            self._held_back = 1 << len(self.conditions)
            self.conditions = (*self.conditions, HELD_BACK)

    def _changing(self, changes: Changes, state: State) -> FloatArray:
        """Velocities while numbers move, which alter none by more than the configured jump.

        The velocities u of a tick's own numbers count where they are no further than that from
        those of the tick before, or from u₀, which the numbers of the tick before give now. Else
        u₀ counts, and the numbers stay; so do they where one of these is no number.
        """
        before, now = self.command.decision, self._candidate
        changes.advance(state.tick)
        u = self.velocity(state)
        if before.size and (np.abs(u - before) <= self._jump).all():
            changes.keep()
            return u
        now[:] = u
        changes.undo()
        unchanged = self.velocity(state)
        if not (np.abs(now - unchanged) <= self._jump).all():
            self.present |= self._held_back
            changes.hold()
            return unchanged
        changes.redo()
        changes.keep()
        return self.velocity(state)

    def _leave(self, leaving: SingularityExit, state: State, u: FloatArray) -> FloatArray:
        """Return the velocities of the motion that leaves a stationary point instead of u."""
        command = self.command
        if not np.isfinite(u).all():
            leaving.stop()
            return u
        base = state.reference if self._from_reference else state.q
        still = self.is_stationary and -command.v_rate_predicted <= SLOW_PER_S * command.v
        if not leaving.advance(state, base, command.v, still=still):
            return u
        self.present |= self._leaving
        command.v_rate_required = command.v_rate_predicted = command.rho = 0.0
        command.margin = command.kkt_residual = 0.0
        command.solver_status = STATUS["uncertified"]
        return leaving.u

    def _history(self, state: State) -> int:
        """What the States seen so far say of the reference's velocity."""
        at_rest, followed, unknown = self._histories
        last, self._periods = self._periods, state.tick - state.skipped
        if state.mode != State.ACTIVE or state.tick == state.epoch_from_tick:
            return at_rest
        return followed if self._periods == last + 1 else unknown
