"""A frame at a pose: position and orientation."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.references.live.live_settings import (
    LivePoseSettings,
)
from hoap3.remote_controller.references.postures import PostureValues, posture_of
from hoap3.remote_controller.references.settings import PoseTarget, target_of
from hoap3.remote_controller.references.target import Approach, Hold, Joined, Point, Target
from hoap3.remote_controller.references.trajectories.trajectory_settings import (
    AXES,
    TURNS,
    TrajectorySettings,
    tolerances_of,
)
from hoap3.remote_controller.tasks.accuracy import (
    TOLERANCE_DEG,
    TOLERANCE_M,
    TaskError,
    ToleranceDeg,
    ToleranceM,
    angle_error,
    length_error,
)
from hoap3.remote_controller.tasks.lyapunov import BuildContext
from hoap3.remote_controller.tasks.task import Task
from hoap3.remote_controller.tasks.task_function import TaskFunction


class FramePoseTask(Task):
    """e = log(M_d⁻¹M) in SE(3): pose M(q) of a frame, in the axes of its target M_d.

    e = (ρ, φ): φ [rad] is the rotation vector from target to frame, |φ| ≤ π, and ρ = Jl⁻¹(φ)·t
    [m] with t the frame's origin in the target's axes. J is exactly ∂e/∂q: the frame's twist,
    in the target's axes, taken through the derivative of the logarithm, Jlog(e). The geometric
    Jacobian, which many use instead, agrees with it only where e = 0; with it V̇ would not be
    what the certificate says. The target's motion enters alike, as ∂e/∂t.

    The logarithm comes from the quaternion and J from cot(|φ|/2), so both are accurate up to half
    a turn. Exactly there e is one of two opposites: V is continuous, ∇V points either way, and
    status says `at_antipode`.

    Args:
        kinematics: of the robot.
        frame, reference: names.
        target: (6,) p_d [m] and the rotation vector of R_d (axis × angle [rad]), both in the
            reference's axes.

    Raises:
        FrameNotFoundError: the robot has no such frame.
    """

    class Parameters(PostureValues, Task.Parameters):
        """Which frame, and where it shall be; the last three weights are in m²/rad²."""

        frame: str = Field(description="frame that shall get there")
        reference: str | None = Field(
            None, description="frame that it is seen from; null: the base frame"
        )
        target: PoseTarget | None = Field(
            None,
            description="where its origin shall be, in that frame; `kind: live`: the whole pose, "
            "or beside rotation_rad the origin alone",
        )
        rotation_rad: tuple[float, float, float] | None = Field(
            None,
            description="axis × angle of its orientation, in that frame [rad]; null: its axes, or "
            "steered as well",
        )
        posture: str | None = Field(
            None,
            description="instead of a target: where the frame is in a posture of the robot's "
            "description; null as well: where it is at the start",
        )
        posture_rad: tuple[float, ...] = Field((), description="or in this posture [rad or m]")
        turn_s: float = Field(
            0.0, ge=0, description="duration of the turn from where it is [s]; 0: at once"
        )
        tolerance_m: ToleranceM = TOLERANCE_M
        tolerance_deg: ToleranceDeg = TOLERANCE_DEG

        @model_validator(mode="after")
        def _one_goal(self) -> Self:
            given = self.target is not None, self.posture is not None, bool(self.posture_rad)
            if sum(given) > 1:
                raise ValueError("should have one of target, posture and posture_rad")
            if not given[0] and (any(self.rotation_rad or ()) or self.turn_s):
                raise ValueError("should have a target beside rotation_rad and turn_s")
            live = isinstance(self.target, LivePoseSettings)
            if live and self.rotation_rad is None and self.turn_s:
                raise ValueError("should have no turn_s where the orientation is steered")
            return self

        @property
        def rotation(self) -> tuple[float, float, float]:
            """`rotation_rad`, or none."""
            return self.rotation_rad or (0.0, 0.0, 0.0)

    def __init__(
        self, kinematics: Kinematics, frame: str, reference: str, target: FloatArray
    ) -> None:
        from hoap3.remote_controller.tasks.se3_kernels import pose_error, rotation_vector

        super().__init__(6, kinematics.n)
        self._pose_error, self._rotation_vector = pose_error, rotation_vector
        self._frame, self._reference = kinematics.frame_id(frame), kinematics.frame_id(reference)
        self._twist = np.zeros((6, kinematics.n))
        self._work = np.zeros((2, 3, 3))
        self._error_rate = np.zeros(6)
        self.position, self.rotation = np.zeros(3), np.eye(3)
        self.target[:] = target
        self.tolerances = TOLERANCE_M, TOLERANCE_DEG

    @classmethod
    def configured(cls, context: BuildContext, parameters: Parameters) -> TaskFunction:
        """V of this task."""
        reference = parameters.reference or context.description.base_frame
        task = cls(context.kinematics, parameters.frame, reference, np.zeros(6))
        task.apply(parameters)
        target, names = task._aim(context, parameters), (*AXES, *TURNS)
        units = ["m"] * len(AXES) + ["rad"] * len(TURNS)
        tolerances = tolerances_of(parameters.target, target, names, units)
        return TaskFunction(task, target, parameters.weights, tolerances)

    def _aim(self, context: BuildContext, parameters: Parameters) -> Target:
        """What the settings ask for, (6,)."""
        if isinstance(parameters.target, TrajectorySettings):
            path = parameters.target.pose(context.folder)
            if path.dimension == len(self.target):
                return _alone(path, parameters)
        if isinstance(parameters.target, LivePoseSettings) and parameters.rotation_rad is None:
            return parameters.target.pose()
        if parameters.target is not None:
            turn = Approach(Point(np.array(parameters.rotation)), parameters.turn_s)
            return Joined(target_of(parameters.target, context.folder), turn)
        if parameters.posture is None and not parameters.posture_rad:
            return Hold(6)
        wanted = parameters.posture, parameters.posture_rad
        context.kinematics.update(posture_of(context.description, *wanted, "posture"))
        pose = np.zeros(6)
        self.read(context.kinematics, pose)
        return Point(pose)

    def apply(self, parameters: Any) -> None:
        """Read the tolerances."""
        self.tolerances = parameters.tolerance_m, parameters.tolerance_deg

    def update(self, kinematics: Kinematics) -> None:
        """Recompute e, J = ∂e/∂q, and ∂e/∂t from `target_rate`."""
        self._see(kinematics)
        self.status = self._pose_error(
            self.position,
            self.rotation,
            self._twist,
            self.target,
            self.target_rate,
            self._work,
            self.error,
            self.jacobian,
            self._error_rate,
        )

    def explicit_rate(self, out: FloatArray) -> None:
        """Write ∂e/∂t, (6,)."""
        out[:] = self._error_rate

    def accuracy(self, asked: NDArray[np.bool_]) -> list[TaskError]:
        """Distance to the target, and angle."""
        length, angle = self.error[:3][asked[:3]], self.error[3:][asked[3:]]
        length_m, angle_deg = self.tolerances
        return length_error(length, length_m) + angle_error(angle, angle_deg)

    def read(self, kinematics: Kinematics, out: FloatArray) -> None:
        """Write p, and of both rotation vectors of R the one nearer to the target's, (6,)."""
        self._see(kinematics)
        out[:3] = self.position
        self._rotation_vector(self.rotation, self.target[3:], out[3:])

    def _see(self, kinematics: Kinematics) -> None:
        kinematics.frame(self._frame, self._reference, self.position, self.rotation, self._twist)


def _alone(path: Target, parameters: FramePoseTask.Parameters) -> Target:
    """A trajectory of poses, beside which no other orientation may stand.

    Raises:
        ConfigError: one does.
    """
    for key in ("rotation_rad", "turn_s"):
        if key in parameters.model_fields_set:
            problem = "stands beside a trajectory that has an orientation"
            remedy = "Leave it out, or the columns qx, qy, qz, qw"
            raise ConfigError("", key, getattr(parameters, key), problem, remedy)
    return path
