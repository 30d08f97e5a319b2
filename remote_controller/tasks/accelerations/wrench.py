"""A wrench along some directions, in place of a pose along them, from the first touch on."""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.references.live.live import Live
from hoap3.remote_controller.references.live.live_settings import LiveWrenchSettings
from hoap3.remote_controller.references.settings import TargetSettings
from hoap3.remote_controller.tasks.accelerations.standing import turned
from hoap3.remote_controller.tasks.accuracy import (
    TOLERANCE_DEG,
    TOLERANCE_M,
    TaskError,
    ToleranceDeg,
    ToleranceM,
)
from hoap3.remote_controller.tasks.frames.frame_position import FramePositionTask
from hoap3.remote_controller.tasks.lyapunov import BuildContext
from hoap3.remote_controller.tasks.task_function import TaskFunction

Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
AXES: tuple[Axis, ...] = ("x", "y", "z", "rx", "ry", "rz")
TOLERANCE = 0.05  # of what is wanted, and at least:
LEAST_TOLERANCE_N, LEAST_TOLERANCE_NM = 0.5, 0.05
NEAR = 0.9  # cosine, above which the reference's x is too near to a normal to be the contact's x


class WrenchTask(FramePositionTask):
    """A frame at a target, until it touches; then a wrench along the chosen directions.

    Both in one task: two tasks without priority over each other would each feed into the rows of
    the other. Three rows, the origin in the root's axes; or six, and its orientation below, where a
    torque is to be kept or an orientation is asked for. What it asks for says `WrenchControl`.
    """

    levels = ("acceleration",)

    class Parameters(Settings):
        """Where to touch, along which directions, and how firmly."""

        frame: str = Field(description="frame that shall get there")
        reference: str | None = Field(
            None, description="frame that it is seen from, and that stands; null: the base frame"
        )
        target: TargetSettings | None = Field(
            None,
            description="where its origin shall be, in that frame; null: where it is at the start",
        )
        rotation_rad: tuple[float, float, float] | Literal["hold"] | None = Field(
            None,
            description="axis × angle of its orientation, in that frame [rad]; hold: as it is at "
            "the start; null: free, or held where `axes` has torques",
        )
        normal: tuple[float, float, float] | None = Field(
            None,
            description="of the surface, towards the robot, in the reference; of any length; z of "
            "the contact's axes",
        )
        force_n: float | None = Field(
            None, gt=0, description="with which it shall press along `normal`, and no more"
        )
        axes: tuple[Axis, ...] = Field(
            (),
            description="or several directions: forces x, y, z and torques rx, ry, rz, along and "
            "about the contact's axes; in the others it keeps its place",
        )
        wrench: tuple[float, ...] = Field(
            (), description="what it shall feel along each of `axes` [N, N m]"
        )
        wrench_target: LiveWrenchSettings | None = Field(
            None,
            description="`kind: live`: somebody steers the wrench, from `force_n` or `wrench` on",
        )
        axes_rad: tuple[float, float, float] | None = Field(
            None,
            description="axis × angle of the contact's axes, in the reference [rad]; null: the "
            "reference's, or those of `normal`",
        )
        tolerance_m: ToleranceM = TOLERANCE_M
        tolerance_deg: ToleranceDeg = TOLERANCE_DEG
        tolerance_n: float | None = Field(
            None,
            gt=0,
            description="error of each force at the end that counts as reached [N]; null: 5 % of "
            "what is wanted, at least 0.5",
        )
        tolerance_nm: float | None = Field(
            None, gt=0, description="the same for torques [N m]; null: 5 %, at least 0.05"
        )
        sensor: str | None = Field(None, description="frame of the wrench sensor; null: `frame`")
        force_kp: float = Field(0.0, ge=0, description="of the error of the wrench")
        force_ki_per_s: float = Field(
            5.0, ge=0, description="of its integral, which adds or takes at most `integral_max`"
        )
        force_kd: float = Field(
            0.0, ge=0, description="of the velocity along these directions while it touches [1/s]"
        )
        integral_max: tuple[float, ...] = Field(
            (),
            description="one value for each of `axes` [N, N m]; empty: the greatest force wanted, "
            "or the greatest torque",
        )
        touch_n: float = Field(
            0.5,
            gt=0,
            description="force from which on it touches, until it is removed or begins anew",
        )

        @field_validator("axes")
        @classmethod
        def _once(cls, axes: tuple[Axis, ...]) -> tuple[Axis, ...]:
            if len(set(axes)) < len(axes):
                raise ValueError("should name each axis once")
            return axes

        @model_validator(mode="after")
        def _one_form(self) -> Self:
            simple, general = self.force_n is not None, bool(self.axes)
            if simple == general or simple != bool(self.force_n and self.normal):
                raise ValueError("should have `normal` and `force_n`, or `axes` and `wrench`")
            if len(self.wrench) != len(self.axes):
                raise ValueError("should have one value of `wrench` for each of `axes`")
            steered = self.wrench_target
            for given in (steered.lower, steered.upper) if steered is not None else ():
                if given is not None and len(given) != len(self.kept):
                    raise ValueError("should have one value of lower and upper for each direction")
            if self.integral_max and len(self.integral_max) != len(self.kept):
                raise ValueError("should have one value of `integral_max` for each of `axes`")
            if any(most < 0.0 for most in self.integral_max):
                raise ValueError("should have an `integral_max` that is not negative")
            if self.normal is not None and self.axes_rad is not None:
                raise ValueError("should have one of normal and axes_rad")
            if self.normal is not None and not 1e-6 <= math.hypot(*self.normal) <= 1e6:
                raise ValueError("should have a normal that points somewhere, of a length near 1")
            return self

        @property
        def kept(self) -> tuple[tuple[Axis, float], ...]:
            """Directions that are kept in wrench, and what is wanted along each [N, N m]."""
            if self.force_n is not None:
                return (("z", self.force_n),)
            return tuple(zip(self.axes, self.wrench, strict=True))

        @property
        def oriented(self) -> bool:
            """Whether it has six rows."""
            return self.rotation_rad is not None or any(is_torque(axis) for axis in self.axes)

        def contact_axes(self, reference: FloatArray) -> FloatArray:
            """The contact's axes as columns, (3, 3), in the root, as those of the reference are."""
            if self.normal is None:
                return turned(reference, self.axes_rad or (0.0, 0.0, 0.0))
            z = reference @ np.array(self.normal)
            z /= np.linalg.norm(z)
            x = reference[:, 0] if abs(reference[:, 0] @ z) <= NEAR else reference[:, 1]
            y = np.cross(z, x)
            y /= np.linalg.norm(y)
            return np.column_stack([np.cross(y, z), y, z])

    @classmethod
    def configured(cls, context: BuildContext, parameters: Any) -> TaskFunction:
        """Refused: it has no V of its own, as a term of a sum would need.

        Raises:
            ConfigError: always.
        """
        del context, parameters
        problem = "a wrench has no V of its own"
        raise ConfigError("", "", "wrench", problem, "Make it a task beside the others")


class Sensed(NamedTuple):
    """Where a sensor's wrench stands.

    Attributes:
        rotation: of the sensor in the root, (3, 3).
        wrench: about the sensor's origin and in its axes, (6,) [N, N m].
        sensor, origin: of the sensor and of the task's frame, in the root, (3,) [m].
    """

    rotation: FloatArray
    wrench: FloatArray
    sensor: FloatArray
    origin: FloatArray


class TaskMotion(NamedTuple):
    """Where the motion of a task stands; m rows in the root's axes.

    Attributes:
        jacobian, drift: J (m, n) and J̇·dq (m,).
        error, motion, slope, wanted: as `task_acceleration_kernels.desired_accelerations` writes
            them, (m,) each.
    """

    jacobian: FloatArray
    drift: FloatArray
    error: FloatArray
    motion: FloatArray
    slope: FloatArray
    wanted: FloatArray


class WrenchControl:
    """Asks for the acceleration with which a frame keeps a wrench.

    Liu, Tan and Padois (2015), (3), with the measured wrench f, of the surroundings on the robot,
    in the equation of motion: along the kept directions, the rows of S, a_S = Λ_S⁻¹·(S·f − w), less
    a damping kd·S·ν, where the surroundings shall exert w = w_d + kp·(w_d − S·f) + ki·∫(w_d − S·f)
    on the robot, w_d likewise: it rests where S·f = w.
    Across them it asks for its place, as before.

    Of three rows Λ_S⁻¹ = S J M⁻¹ Jᵀ Sᵀ, as (3) has it. Of six it is that with the other directions
    held, (S Λ Sᵀ)⁻¹ with Λ = (J M⁻¹ Jᵀ)⁻¹: the task holds them itself, and a light wrist yields
    much more readily than a hand that is held, so that each change of the measured wrench would be
    answered several times over.

    It touches from the first force of `touch_n` on, along the force that is wanted, or in any
    direction where none is; if the surface then goes away, it follows.

    The integral counts only while the task takes part in full and feels `touch_n` or more: of a
    wrench that it may not, or cannot, have it learns nothing. A task that is out forgets it, and
    that it touched: put in again, it comes to its target as at first.

    Where the wrench is steered, w_d is where that reference is; along what it begins to touch, and
    how much the integral adds, follow from what the settings want by themselves.

    Args:
        settings: of the task.
        axes: the contact's as columns, in the root, (3, 3).
        joints: n.
        period_s: [s].

    Attributes:
        S: (k, m), orthonormal rows in the root's axes; m is 6 with an orientation, else 3.
        touches: whether it does.
        measured: S·f, (k,) [N, N m]; a force is positive where the surface pushes.
    """

    def __init__(
        self, settings: WrenchTask.Parameters, axes: FloatArray, joints: int, period_s: float
    ) -> None:
        from hoap3.remote_controller.tasks.accelerations import wrench_kernels as kernels

        self._kernels = kernels
        self._settings, self._growth = settings, settings.force_ki_per_s * period_s
        self._axes = [axis for axis, _ in settings.kept]
        m = 6 if settings.oriented else 3
        directions = {axis: direction(axes, axis)[:m] for axis in AXES}
        self.S = np.array([directions[axis] for axis in self._axes])
        held = [axis for axis in AXES if axis not in self._axes] if settings.oriented else []
        self._held = np.array([directions[axis] for axis in held]).reshape(-1, m)
        self._torques = [is_torque(axis) for axis in self._axes]
        self._begins = np.array([value for _, value in settings.kept])
        self._wanted = self._begins.copy()
        self._most = np.array(settings.integral_max or self._greatest_of_kind())
        self._along = self._wanted @ self.S[:, :3]  # of torques the first three are 0
        if self._along.any():
            self._along /= np.linalg.norm(self._along)
        k = len(self._axes)
        self._factor, self._rows = np.zeros((joints, joints)), np.zeros((k, joints))
        self._units, self._scratch = np.zeros((len(held), joints)), np.zeros(joints)
        self._inverse_inertia = np.zeros((k, k))
        self.measured, self._aimed, self._integral = np.zeros((3, k))
        self.touches, self._learns = False, False
        steered = settings.wrench_target
        least = -math.inf if settings.force_n is None else 0.0
        self._steered: Live | None = None
        if steered is not None:
            self._steered = steered.build(self._torques, self._axes, least)
        self._rates = np.zeros(k)

    @property
    def errors(self) -> list[TaskError]:
        """How far the measured wrench is from the wanted one, along each direction."""
        tolerances = self._settings.tolerance_n, self._settings.tolerance_nm
        found = []
        for r, torque in enumerate(self._torques):
            wanted = float(self._wanted[r])
            least = LEAST_TOLERANCE_NM if torque else LEAST_TOLERANCE_N
            tolerance = tolerances[int(torque)] or max(TOLERANCE * abs(wanted), least)
            error = abs(wanted - float(self.measured[r]))
            found.append(TaskError(error, "N m" if torque else "N", tolerance))
        return found

    def columns(self, name: str) -> list[str]:
        """Names of what is `measured` in the log: the first force is `force_NAME`."""
        first, *others = self._axes
        start = f"wrench_{name}_{first}" if is_torque(first) else f"force_{name}"
        return [start, *(f"wrench_{name}_{axis}" for axis in others)]

    def reset(self) -> None:
        """Nothing touches yet."""
        self.touches = False
        self.measured[:] = self._integral[:] = 0.0

    def begin(self, time_s: float) -> None:
        """Nothing touches yet, and nobody asked for another wrench, at a time [s]."""
        self.reset()
        if self._steered is not None:
            self._steered.start(self._begins, time_s)
            self.aim(time_s)

    def aim(self, time_s: float) -> None:
        """Take what is wanted at a time [s]."""
        if self._steered is not None:
            self._steered.at(time_s, self._wanted, self._rates)

    def feel(self, sensed: Sensed, absent: float) -> None:
        """Take what the surroundings do to the robot.

        Args:
            sensed: by its sensor.
            absent: how far the task is out, from 0 to 1: α_ii.
        """
        if absent >= 1.0:
            self.reset()
        pressed = self._kernels.measure(*sensed, self.S, self._along, self.measured)
        if absent >= 1.0:
            self._learns = False
            return
        felt = pressed >= self._settings.touch_n
        self.touches, self._learns = self.touches or felt, felt and absent <= 0.0

    def update(self, mass: FloatArray, task: TaskMotion) -> None:
        """Change what the task asks for.

        Args:
            mass: M (n, n).
            task: its rows, of which all but J and J̇·dq are changed.
        """
        kernels, settings = self._kernels, self._settings
        kernels.wrench_to_aim_at(
            self._wanted,
            self.measured,
            settings.force_kp,
            self._growth,
            self._most,
            self._learns,
            self._integral,
            self._aimed,
        )
        kernels.inverse_task_inertia(
            mass,
            task.jacobian,
            self.S,
            self._held,
            self._factor,
            self._rows,
            self._units,
            self._scratch,
            self._inverse_inertia,
        )
        kernels.push(
            self.S,
            self._inverse_inertia,
            self.measured,
            self._aimed,
            settings.force_kd,
            task.drift,
            task.error,
            task.motion,
            task.slope,
            task.wanted,
        )

    def _greatest_of_kind(self) -> list[float]:
        """What is wanted most of all forces, or of all torques, for each direction."""
        greatest = {False: 0.0, True: 0.0}
        for torque, wanted in zip(self._torques, self._wanted, strict=True):
            greatest[torque] = max(greatest[torque], abs(float(wanted)))
        return [greatest[torque] for torque in self._torques]


def direction(axes: FloatArray, axis: Axis) -> FloatArray:
    """An axis as a direction of a twist, (6,), of contact axes that are the columns of (3, 3)."""
    found, start = np.zeros(6), 3 if is_torque(axis) else 0
    found[start : start + 3] = axes[:, AXES.index(axis) % 3]
    return found


def is_torque(axis: Axis) -> bool:
    """Whether an axis is one of a torque."""
    return axis.startswith("r")
