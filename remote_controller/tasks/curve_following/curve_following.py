"""Converging to a curve and circulating it (QP12, section III-D.2)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from pydantic import Field

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import BadProblemError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.references.target import smooth_step
from hoap3.remote_controller.solvers.qp12.pinv import Pinv
from hoap3.remote_controller.tasks import status
from hoap3.remote_controller.tasks.accuracy import (
    TOLERANCE_DEG,
    TOLERANCE_M,
    TaskError,
    angle_error,
    length_error,
)
from hoap3.remote_controller.tasks.com import ComTask
from hoap3.remote_controller.tasks.curve_following.curve import CURVES, Curve, build_curve
from hoap3.remote_controller.tasks.derivative_check import check_derivatives
from hoap3.remote_controller.tasks.frames.frame_position import FramePositionTask
from hoap3.remote_controller.tasks.lyapunov import BuildContext, LyapunovFunction

HELD = 1e-3  # independence of the gradients up to which nothing moves along the curve,
FREE = 0.1  # and from which on motion is not slowed down
LEAST_COSINE = 0.5  # of the turn of the tangent between two ticks


class PersistentMotion(LyapunovFunction):
    """V = ½|α|² of a curve in coordinates x, and the motion along it that a controller adds.

    Problem (23): u minimises φ(∇α_1·u, …), with motion_row·u = ζ and ∇V·u = −ρΨ. Both
    constraints agree everywhere: ∇V = Σ α_i·∇α_i is orthogonal to the tangent in x.

    The tangent's sign is continuous (`curve_kernels.curve_tangent`). Where the gradients of α come
    close to dependent, ζ falls smoothly to 0, and the status is `dependent_gradients`; should the
    tangent turn by more than 60° between two ticks all the same, it is held with ζ = 0 and the
    status `tangent_turned`. Steps of dt leave the curve outwards by about ζ²·dt/2 times its
    curvature each second; Ψ takes that back.

    Args:
        joints: n.
        curve: α and its gradients, in ℝᵐ.
        speed: ζ > 0 [unit of x per s].
        forward: which of both directions.
        objective_weights: (m − 1,) w of φ(y) = ½ Σ w_i·y_i², or one number; none means 1.

    Attributes:
        error, jacobian: α, (m − 1,), and ∂α/∂q, (m − 1, n).
        objective_rows: √w·∂α/∂q, (m − 1, n): φ = ½|objective_rows·u|².
        tangent: T, (m,), unit, in x.
        motion_row: Tᵀ·∂x/∂q, (n,).
        speed: ζ of this tick [unit of x per s].

    Raises:
        BadProblemError: the weights are not positive, or too few or too many.
    """

    def __init__(
        self,
        joints: int,
        curve: Curve,
        speed: float,
        forward: bool = True,
        objective_weights: Sequence[float] = (),
    ) -> None:
        from hoap3.remote_controller.tasks.curve_following.curve_kernels import (
            curve_tangent,
            curve_velocity,
        )
        from hoap3.remote_controller.tasks.lyapunov_kernels import quadratic

        k, m = curve.gradients.shape
        super().__init__(joints, k)
        self._curve_tangent, self._curve_velocity = curve_tangent, curve_velocity
        self._quadratic = quadratic
        self.curve = curve
        self._fastest, self._direction = speed, 1.0 if forward else -1.0
        given = np.array(objective_weights or (1.0,), float)
        if given.size not in {1, k} or not (given > 0.0).all():
            raise BadProblemError(
                f"objective_weights {list(objective_weights)}: expected 1 or {k} numbers > 0",
                "objective_weights",
            )
        self._weights = np.broadcast_to(given, (k,)).copy()
        self._column = np.sqrt(self._weights)[:, None]
        self.x, self.x_jacobian = np.zeros(m), np.zeros((m, joints))
        self.tangent, self._last = np.zeros(m), np.zeros(m)
        self._error, self._error_rate = np.zeros((2, k + 1))
        self._jacobian = np.zeros((k + 1, joints))
        self.error, self.jacobian = self._error[:k], self._jacobian[:k]
        self.motion_row, self.speed = self._jacobian[k], 0.0
        self.objective_rows = np.zeros((k, joints))
        self._slopes = np.zeros((k, joints))
        self._still, self._ones = np.zeros(k), np.ones(k)
        self._rows, self._factor, self._work = np.zeros((3, m, m))
        self._x_rate, self._scratch = np.zeros(m), np.zeros(m)
        self._independence = 0.0

    @abstractmethod
    def locate(self, kinematics: Kinematics) -> None:
        """Recompute `x`, (m,), and `x_jacobian`, (m, n)."""

    def reset(self, kinematics: Kinematics, time_s: float) -> None:
        """Forget the last tangent."""
        del kinematics, time_s
        self._last[:] = 0.0

    def update(self, kinematics: Kinematics, time_s: float) -> None:
        """Recompute V and ∇V; tangent, speed and rows as well."""
        del time_s
        self.locate(kinematics)
        curve = self.curve
        curve.evaluate(self.x)
        np.matmul(curve.gradients, self.x_jacobian, out=self._slopes)
        self.value, self.rate = self._quadratic(
            curve.alpha,
            self._slopes,
            self._still,
            self._ones,
            self.error,
            self.jacobian,
            self.gradient,
        )
        np.multiply(self.jacobian, self._column, out=self.objective_rows)
        independence, cosine = self._curve_tangent(
            curve.gradients,
            self._direction,
            self._last,
            self._rows,
            self._factor,
            self._work,
            self.tangent,
        )
        self._decide(independence, cosine)
        np.matmul(self.tangent, self.x_jacobian, out=self.motion_row)
        self._error_rate[-1] = -self.speed

    @property
    def followed(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """α and below it 0, with motion_row·u = ζ as the last of the rows."""
        return self._error, self._jacobian, self._error_rate

    def velocity(self, decrease: float, out: FloatArray) -> bool:
        """Write the u that solves (23) without inequality constraints, (n,).

        Where x has fewer coordinates than there are joints, it is the shortest of all that do.

        Args:
            decrease: ρΨ ≥ 0.
            out: u [rad/s or m/s]; 0 where the gradients are too dependent to say anything.

        Returns:
            Whether V decreases as demanded: V = 0 cannot, nor can it where the motion is held.
        """
        if self._independence <= HELD:
            out[:] = 0.0
            return decrease == 0.0
        solved = self._curve_velocity(
            self.error,
            self._weights,
            self._rows,
            self._factor,
            self.tangent,
            self.speed,
            decrease,
            self._scratch,
            self._x_rate,
        )
        self._to_joints(self._x_rate, out)
        return bool(solved)

    @abstractmethod
    def _to_joints(self, x_rate: FloatArray, out: FloatArray) -> None:
        """Write the u that moves x at `x_rate`."""

    def _decide(self, independence: float, cosine: float) -> None:
        """Set ζ and the status, and remember the tangent or go back to the last one."""
        self._independence = independence
        self.status, self.speed = status.OK, 0.0
        if independence <= HELD:
            self.status = status.DEPENDENT_GRADIENTS
            self.tangent[:] = self._last
            return
        if cosine < LEAST_COSINE:
            self.status = status.TANGENT_TURNED
            self.tangent[:] = self._last
            return
        self._last[:] = self.tangent
        share, _ = smooth_step((independence - HELD) / (FREE - HELD))
        if share < 1.0:
            self.status = status.DEPENDENT_GRADIENTS
        self.speed = self._fastest * share * self.curve.pace(self.x)


def check_curve(motion: PersistentMotion, name: str, context: BuildContext) -> None:
    """Refuse somebody else's curve whose gradients are not those of its α.

    Raises:
        ConfigError: see `check_derivatives`.
    """
    if name not in CURVES.builtin:
        at_name = BuildContext(
            context.description, context.kinematics, context.file, f"{context.key}.curve"
        )
        check_derivatives(motion, at_name, name, of_error=False)  # signs of α may change


class _MotionSettings(Settings):
    direction: Literal["forward", "backward"] = Field(
        "forward",
        description="forward: gradients of α, then the tangent, have a positive determinant; "
        "of an ellipse: from its first axis to its second",
    )
    objective_weights: tuple[float, ...] = Field(
        (), description="w of φ = ½ Σ w·(dα/dt)²: one number, or one for each α; empty: 1"
    )
    curve_parameters: dict[str, Any] = Field({}, description="settings of the curve itself")


class JointCurve(PersistentMotion):
    """A curve in the space of the joints: x = q, given by n − 1 functions."""

    tolerance_deg = TOLERANCE_DEG

    class Parameters(_MotionSettings):
        """Which curve, and how fast."""

        curve: str = Field("joint_ellipse", description="registered name, or package.module:Class")
        speed_rad_s: float = Field(gt=0, description="ζ, of all joints together")
        tolerance_deg: float = Field(
            TOLERANCE_DEG,
            gt=0,
            description="distance to the curve, |α|, at the end that counts as reached [degrees]",
        )

    @classmethod
    def configured(cls, context: BuildContext, parameters: Parameters) -> JointCurve:
        """The motion that the parameters describe."""
        n = context.description.n
        curve = build_curve(
            parameters.curve, parameters.curve_parameters, n, context, f"{context.key}.curve"
        )
        forward = parameters.direction == "forward"
        motion = cls(n, curve, parameters.speed_rad_s, forward, parameters.objective_weights)
        np.fill_diagonal(motion.x_jacobian, 1.0)
        motion.tolerance_deg = parameters.tolerance_deg
        check_curve(motion, parameters.curve, context)
        return motion

    def locate(self, kinematics: Kinematics) -> None:
        """Take x = q."""
        kinematics.joints(self.x)

    def accuracy(self) -> list[TaskError]:
        """Distance to the curve."""
        return angle_error(self.error, self.tolerance_deg)

    def _to_joints(self, x_rate: FloatArray, out: FloatArray) -> None:
        out[:] = x_rate


class TaskCurve(PersistentMotion):
    """A curve in space, given by two functions: x is the CoM or a frame's origin, as seen from one.

    Args:
        task: whose `error` is x, for its target is 0.
        curve, speed, forward, objective_weights: see `PersistentMotion`.
    """

    tolerance_m = TOLERANCE_M

    class Parameters(_MotionSettings):
        """What circulates which curve, and how fast."""

        point: str = Field("com", description="com, or the frame whose origin it is")
        reference: str = Field("r_sole", description="frame that it is seen from")
        curve: str = Field("ellipse", description="registered name, or package.module:Class")
        speed_m_s: float = Field(gt=0, description="ζ, along the curve [m/s]")
        tolerance_m: float = Field(
            TOLERANCE_M,
            gt=0,
            description="distance to the curve, |α|, at the end that counts as reached [m]",
        )

    def __init__(
        self,
        task: ComTask | FramePositionTask,
        curve: Curve,
        speed: float,
        forward: bool = True,
        objective_weights: Sequence[float] = (),
    ) -> None:
        super().__init__(task.jacobian.shape[1], curve, speed, forward, objective_weights)
        self._task = task
        self._pinv = Pinv(*task.jacobian.shape)
        self.x, self.x_jacobian = task.error, task.jacobian

    @classmethod
    def configured(cls, context: BuildContext, parameters: Parameters) -> TaskCurve:
        """The motion that the parameters describe."""
        origin = np.zeros(3)
        task: ComTask | FramePositionTask
        if parameters.point == "com":
            task = ComTask(context.kinematics, parameters.reference, origin)
        else:
            task = FramePositionTask(
                context.kinematics, parameters.point, parameters.reference, origin
            )
        curve = build_curve(
            parameters.curve, parameters.curve_parameters, 3, context, f"{context.key}.curve"
        )
        forward = parameters.direction == "forward"
        motion = cls(task, curve, parameters.speed_m_s, forward, parameters.objective_weights)
        motion.tolerance_m = parameters.tolerance_m
        check_curve(motion, parameters.curve, context)
        return motion

    def locate(self, kinematics: Kinematics) -> None:
        """Have the task look."""
        self._task.update(kinematics)

    def accuracy(self) -> list[TaskError]:
        """Distance to the curve."""
        return length_error(self.error, self.tolerance_m)

    def _to_joints(self, x_rate: FloatArray, out: FloatArray) -> None:
        self._pinv.solve_plain(self.x_jacobian, x_rate, -1.0, out)
