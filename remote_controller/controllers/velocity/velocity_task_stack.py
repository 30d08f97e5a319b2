"""What controllers of joint velocities with several tasks have in common."""

from __future__ import annotations

from abc import abstractmethod
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE, GREATEST_SPEED
from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import ConfigError, located
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.joints.reference_velocity import ReferenceVelocity
from hoap3.remote_controller.controllers.base import STATUS, VIOLATED, VelocityController
from hoap3.remote_controller.controllers.singularity import LeaveSingularity
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.scheduling.changes import part_of
from hoap3.remote_controller.tasks import registry as tasks
from hoap3.remote_controller.tasks import status as task_status
from hoap3.remote_controller.tasks.accuracy import LOWER, TaskError, name_errors
from hoap3.remote_controller.tasks.registry import LabelledTask, labels_of

MARGIN_ROUNDING = 1e-9  # of a velocity beside its bounds [rad/s or m/s]
INSIDE = 1.0 - 1e-9  # of the greatest acceleration: the robot judges by rounded positions
Positive = Annotated[float, Field(gt=0)]


class VelocityBounds(Settings):
    """What joints may do, beside their ranges; the robot need not intervene then."""

    speed_rad_s: Annotated[Positive | None, GREATEST_SPEED] = Field(
        None,
        description="greatest speed of every joint; null: the description's [rad/s or m/s]",
        json_schema_extra=CHANGEABLE,
    )
    acceleration_rad_s2: Positive | None = Field(
        None, description="greatest acceleration; null: what the robot brakes with [rad/s² or m/s²]"
    )
    margin_rad: float = Field(
        1e-9, ge=0, description="taken off both ends of the usable range [rad or m]"
    )

    def limits(self, description: RobotDescription) -> FloatArray:
        """Range, greatest speed and acceleration, (4, n), none beyond the description's.

        Raises:
            ConfigError: the margin leaves nothing of a range.
        """
        robot, room = description, description.upper - description.lower
        if (room < 2.0 * self.margin_rad).any():
            joint = int(np.argmin(room))
            problem = f"leaves nothing of the range of joint {robot.joint_names[joint]!r}"
            remedy = f"At most {room[joint] / 2.0}"
            raise ConfigError("", "bounds.margin_rad", self.margin_rad, problem, remedy)
        hardest = INSIDE * robot.setpoint_acceleration_max
        acceleration = self.acceleration_rad_s2 or robot.brake_acceleration
        return np.array(
            [
                robot.lower + self.margin_rad,
                robot.upper - self.margin_rad,
                np.minimum(robot.velocity, self.speed_rad_s or np.inf),
                np.minimum(hardest, acceleration) * np.ones(robot.n),
            ]
        )


class LabelledTaskParameters(VelocityController.Parameters):
    """What all of them have."""

    tasks: tuple[LabelledTask, ...] | None = Field(min_length=1, description="its tasks")
    bounds: VelocityBounds = Field(VelocityBounds(), description="of the joint velocities")
    kinematics_from: Literal["measured", "reference"] = Field(
        "measured", description="joint positions that kinematics are computed from"
    )
    leave_singularity: LeaveSingularity = False


class LabelledTasksController(VelocityController):
    """Stacks the tasks of a config, and bounds joint velocities; a subclass answers with u.

    Its `__init__` ends with `self.apply(parameters)`.

    Columns are `error_NAME`, |e| of each task, and then what a subclass adds in `columns`. It names
    its conditions in `own_conditions`, first that the State is not finite; those of the tasks
    follow.

    Attributes:
        labels, sizes: name and number of rows of each task.
        functions: the tasks, in the order of the config.
        offsets: where the rows of each begin, and their number; (k + 1,).
        jacobian, errors, rates: of all tasks, (m, n), σ* − σ, (m,), and ∂/∂t of it, (m,).
        lower, upper: of the velocities in this cycle: speed, acceleration, and stopping before the
            end of the range, so that the robot has nothing to hold back; (n,) [rad/s or m/s].
        u: the answer, (n,) [rad/s or m/s].

    Raises:
        ConfigError: a task that cannot be built for the robot, or without an error; two of one
            name.
    """

    own_conditions: tuple[str, ...] = ("state not finite",)
    kernels: ClassVar[tuple[str, ...]] = (
        "hoap3.remote_controller.controllers.progress_kernels",
        "hoap3.remote_controller.references.approach_kernels",
        "hoap3.remote_controller.tasks.lyapunov_kernels",
        "hoap3.remote_controller.tasks.curve_following.curve_kernels",
        "hoap3.remote_controller.tasks.se3_kernels",
        "hoap3.remote_controller.constraints.joints.viability_kernels",
        "hoap3.remote_controller.controllers.velocity.velocity_task_stack_kernels",
    )

    def __init__(
        self, description: RobotDescription, parameters: LabelledTaskParameters, file: str
    ) -> None:
        from hoap3.remote_controller.constraints.joints.viability_kernels import velocity_bounds
        from hoap3.remote_controller.controllers.velocity import (
            velocity_task_stack_kernels as kernels,
        )

        given = parameters.tasks or ()
        self.labels = labels_of(given)
        self.kinematics = Kinematics(description)
        self.functions = [
            tasks.build_with_error(
                task, description, self.kinematics, file, f"parameters.tasks.{number}"
            )
            for number, task in enumerate(given)
        ]
        self._entries = given
        self.sizes = [len(function.followed[0]) for function in self.functions]
        self.extra_names = (*(f"error_{label}" for label in self.labels), *self.columns())
        n, m = description.n, sum(self.sizes)
        self.arrays = {"gains": m}
        super().__init__(description, parameters)
        self.offsets = np.concatenate([[0], np.cumsum(self.sizes)]).astype(np.int64)
        self.jacobian, self.errors, self.rates = np.zeros((m, n)), np.zeros(m), np.zeros(m)
        self._rows = [
            (self.errors[start:end], self.rates[start:end], self.jacobian[start:end])
            for start, end in pairwise(self.offsets.tolist())
        ]
        self._stack, self._cut = kernels.stack, kernels.cut
        self._velocity_bounds = velocity_bounds
        for place, (label, function) in enumerate(zip(self.labels, self.functions, strict=True)):
            self.parts += part_of(function, ("tasks", label), ("tasks", place))
        self._bounds = np.zeros((4, n))
        self.lower, self.upper, self.u, self._next = np.zeros((4, n))
        self._reference_velocity = ReferenceVelocity(n, description.period_s)
        self.conditions = (*self.own_conditions, *task_status.NAMES[1:])
        self._watched = [function for function in self.functions if function.watched]
        self._violation = 1 << len(self.conditions)
        if self._watched:
            self.conditions = (*self.conditions, VIOLATED)
        followed = [self._followed_task(place) for place in range(len(given))]
        self._find = self.watch_progress(followed, (self.lower, self.upper)).find
        self.leave_singularities(parameters)
        self._begun = False
        self.margin_tolerance = MARGIN_ROUNDING

    def _followed_task(self, place: int) -> tasks.FollowedTask:
        """Return the rows of a task that are those of its error, and their names."""
        entry, function = self._entries[place], self.functions[place]
        first = int(self.offsets[place])
        rows, base = slice(first, first + len(function.error)), self.description.base_frame

        def judged() -> bool:
            return bool(self.judged()[place])

        return tasks.followed_task(entry.label, entry, rows, function.accuracy, base, judged)

    @classmethod
    def configured(cls, description: RobotDescription, parameters: Any, file: str) -> Self:
        """One for a robot."""
        return cls(description, parameters, file)

    @classmethod
    def check(cls, parameters: Any, file: str) -> None:
        """Refuse tasks that are wrong for any robot."""
        given = parameters.tasks or ()
        for number, task in enumerate(given):
            tasks.check_parameters(task, file, f"parameters.tasks.{number}")
        with located(file, "parameters"):
            labels_of(given)

    def apply(self, parameters: Any) -> None:
        """Read the bounds; gains beyond 1/T, which pass the target, are refused."""
        period_s = self.description.period_s
        for place, task in enumerate(parameters.tasks or ()):
            gain = getattr(task, "gain_per_s", 0.0)
            if gain * period_s > 1.0:
                key, problem = f"tasks.{place}.gain_per_s", "passes the target in one period"
                raise ConfigError("", key, gain, problem, f"At most {1.0 / period_s:g}, 1/T")
        self._bounds[:] = parameters.bounds.limits(self.description)

    @abstractmethod
    def judged(self) -> list[bool]:
        """Which tasks must reach their target: those that no other may keep from it."""

    def margin_of(self) -> tuple[str, str]:
        """The bounds."""
        return "bounds of joints", "rad/s or m/s"

    def task_errors(self) -> list[TaskError]:
        """Errors of all tasks; those of lower priority are not judged."""
        return [
            self.explained(error, label)
            for label, function, judged in zip(
                self.labels, self.functions, self.judged(), strict=True
            )
            for error in name_errors(function.accuracy(), label, "" if judged else LOWER)
        ]

    def columns(self) -> tuple[str, ...]:
        """Columns beside the errors; called once, when labels and sizes are known."""
        return ()

    @abstractmethod
    def answer(self, state: State, base: FloatArray, now: float, noted: int) -> None:
        """Write `u`, the certificate and what is `present`.

        Args:
            state: of the robot; finite.
            base: joint positions that the kinematics are those of, (n,).
            now: time of the targets [s].
            noted: conditions of the tasks.
        """

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Begin anew; the tasks do at the next State that is finite."""
        super().reset(state, last_command)
        self._begun = False
        self._reference_velocity.reset()

    def velocity(self, state: State) -> FloatArray:
        """Joint velocities, and their certificate."""
        if not np.isfinite(state.q @ state.reference):
            self.command.stamp_kinematics = self.now()
            return self._refuse()
        base = state.reference if self._from_reference else state.q
        now = state.tick * self._dt
        self.kinematics.update(base)
        if not self._begun:
            for function in self.functions:
                function.reset(self.kinematics, now)
            self._begun = True
        dq = self._reference_velocity.update(state)
        self._velocity_bounds(state.reference, dq, self._bounds, self._dt, self.lower, self.upper)
        violated = self._violation if self._watch(state, base, now) else 0
        noted = self._look(now) | violated
        self.answer(state, base, now, noted)
        errors = self.errors, self.jacobian, -1.0
        self.present |= self._find(state.tick, errors, self.u)
        self._doubt()
        return self.u

    def gradient_at(self, q: FloatArray, time_s: float) -> FloatArray:
        """Evaluate the tasks at joint positions; return ∇V of those that must be reached."""
        self.kinematics.update(q)
        self._look(time_s)
        found = np.zeros(len(q))
        for function, judged in zip(self.functions, self.judged(), strict=True):
            found += function.gradient if judged else 0.0
        return found

    def _doubt(self) -> None:
        """Take back a proof that says too much: of a stationary task, or one not at its target."""
        command = self.command
        arrived = command.solver_status == STATUS["at_target"]
        if arrived or command.solver_status == STATUS["certified"]:
            far = arrived and any(
                not error.within
                for function, judged in zip(self.functions, self.judged(), strict=True)
                for error in (function.accuracy() if judged else ())
            )
            if far or self.is_stationary:
                command.solver_status = STATUS["uncertified"]

    def _watch(self, state: State, base: FloatArray, now: float) -> bool:
        """Whether a tolerance is, or was, violated by the robot as it was measured."""
        if not self._watched or state.mode != State.ACTIVE:  # else nobody follows
            return False
        kinematics, tick = self.kinematics, state.tick
        if self._from_reference:
            kinematics.update(state.q)
        violated = max(each.watch(kinematics, tick, now) for each in self._watched)
        if self._from_reference:
            kinematics.update(base)
        return violated

    def _look(self, now: float) -> int:
        """Stack the tasks; log their errors; the conditions that they note."""
        extra, noted = self.command.extra, 0
        for place, (function, (errors, rates, jacobian)) in enumerate(
            zip(self.functions, self._rows, strict=True)
        ):
            function.update(self.kinematics, now)
            error, slope, error_rate = function.followed
            extra[place] = self._stack(error, error_rate, slope, errors, rates, jacobian)
            if function.status:
                noted |= 1 << (len(self.own_conditions) + function.status - 1)
        return noted

    def _go_ahead(self, base: FloatArray) -> None:
        """Have the kinematics be those at the end of the period."""
        np.multiply(self.u, self._dt, out=self._next)
        np.add(base, self._next, out=self._next)
        self.kinematics.update(self._next)

    def _refuse(self) -> FloatArray:
        """Nothing to follow for a State that is not finite."""
        self.refuse(1)
        self.u[:] = np.nan
        return self.u
