"""Several constraints as one problem's rows and bounds of joint accelerations and torques."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hoap3.protocol.errors import located
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.constraint import Constraint
from hoap3.remote_controller.constraints.coordinated_stop import CoordinatedStop
from hoap3.remote_controller.constraints.joints.joint_acceleration import JointAcceleration
from hoap3.remote_controller.constraints.stack import Stack, overrides
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.model.motion import Motion

KERNELS = (
    "hoap3.remote_controller.model.drift_kernels",
    "hoap3.remote_controller.constraints.limit_kernels",
    "hoap3.remote_controller.constraints.joints.viability_kernels",
    "hoap3.remote_controller.constraints.collision.distance_kernels",
    "hoap3.remote_controller.constraints.frames.fixed_frame_kernels",
    "hoap3.remote_controller.constraints.collision.distance_curvature_kernels",
)
"""What a controller that has such a stack names among its `kernels`."""
MOST = 63  # constraints: `held` has a bit for each


class AccelerationStack(Stack):
    """Constraints one below the other, in preallocated arrays that every update rewrites.

    Bounds on accelerations themselves come first, whatever the order, so no other entry can ask a
    joint for more than it can do. Without constraints an update does nothing.

    Args:
        constraints, labels: as of `Stack`; all serve accelerations.
        keys: where the parameters of each stand in the config, for errors.
        description, kinematics: of the robot; `kinematics` is moved by updates.
        file: which config, for errors.
        brake: (n,) what joints can brake with, where the robot could with more [rad/s² or m/s²].

        ranges: (n,) least and greatest positions that joints keep besides [rad or m].

    Attributes:
        names: (s,) of the rows.
        rows, rows_lower, rows_upper: (s, n), (s,), (s,) lower ≤ G·q̈ ≤ upper; equal ends are an
            equation, a row that is off has ∓inf.
        lower, upper: (n,) of q̈ [rad/s² or m/s²]; ∓inf where nothing bounds a joint.
        torque_max: (n,) of |τ| [N m or N]; inf where nothing bounds one.

    Raises:
        ConfigError: a constraint that cannot be kept by accelerations of this robot.
    """

    def __init__(
        self,
        constraints: Sequence[Constraint],
        labels: Sequence[str],
        keys: Sequence[str],
        description: RobotDescription,
        kinematics: Kinematics,
        file: str,
        brake: FloatArray | float = np.inf,
        ranges: tuple[FloatArray | float, FloatArray | float] = (-np.inf, np.inf),
    ) -> None:
        from hoap3.remote_controller.constraints.limit_kernels import held_rows

        speed, deceleration = _joints_can(constraints, description, brake)
        for constraint, key in zip(constraints, keys, strict=True):
            with located(file, key):
                constraint.prepare_accelerations(speed, deceleration)
        super().__init__(constraints, labels)
        self._held_rows, n = held_rows, description.n
        self.names = tuple(
            f"{label}: {name}"
            for label, constraint in zip(self.labels, self.constraints, strict=True)
            for name in constraint.names
        )
        s = len(self.names)
        owners = [i for i, each in enumerate(self.constraints) for _ in each.names]
        self._owners = np.array(owners, np.int64)
        self.rows = np.zeros((s, n))
        self.rows_lower, self.rows_upper = np.full(s, -np.inf), np.full(s, np.inf)
        self.lower, self.upper = np.full(n, -np.inf), np.full(n, np.inf)
        self.torque_max = np.full(n, np.inf)
        for constraint in self.constraints:
            if constraint.torque_max is not None:
                np.minimum(self.torque_max, constraint.torque_max, out=self.torque_max)
        self._views: list[tuple[Constraint, FloatArray, FloatArray, FloatArray]] = []
        taken = 0
        for constraint in self.constraints:
            if constraint.rows:
                rows = slice(taken, taken + constraint.rows)
                ends = self.rows_lower[rows], self.rows_upper[rows]
                self._views.append((constraint, self.rows[rows], *ends))
            taken += constraint.rows
        self._bounding = sorted(
            (each for each in self.constraints if overrides(each, "bound_accelerations")),
            key=lambda constraint: not isinstance(constraint, JointAcceleration),
        )
        self._motion = Motion(description, kinematics) if self._views else None
        self._stop: CoordinatedStop | None = None
        if self.constraints:
            aside = Kinematics(description)
            for frame in description.frames:
                aside.frame_id(frame)
            period_s = self.constraints[0].period_s
            self._stop = CoordinatedStop(
                self.constraints, description, aside, deceleration, period_s, *ranges
            )

    def update(
        self,
        q: FloatArray,
        dq: FloatArray,
        state: State,
        lower: FloatArray | float = -np.inf,
        upper: FloatArray | float = np.inf,
    ) -> None:
        """Rewrite all arrays for a state.

        Args:
            q, dq: (n,) positions and velocities, finite [rad, rad/s or m, m/s].
            state: that they are of.
            lower, upper: (n,) of q̈, which constraints narrow.
        """
        self.lower[:], self.upper[:] = lower, upper
        for constraint in self._bounding:
            constraint.bound_accelerations(state, self.lower, self.upper)
        if self._motion is None:
            return
        self._motion.update(q, dq)
        for constraint, rows, least, most in self._views:
            constraint.update_accelerations(self._motion, state, rows, least, most)

    def held(self, ddq: FloatArray) -> int:
        """Bit i: accelerations, (n,), are on a row of constraint i that is no equation."""
        return int(self._held_rows(self.rows, self.rows_lower, self.rows_upper, ddq, self._owners))

    def stop(self, dq: FloatArray, out: FloatArray) -> None:
        """Write the accelerations, (n,), with which all joints together begin to brake from dq.

        They are those of the stop that `stop_is_safe` looks at; nan where it has no end.
        """
        if self._stop is None:
            out[:] = np.nan
        else:
            self._stop.accelerations(dq, out)

    def stop_is_safe(self, q_next: FloatArray, dq_next: FloatArray) -> bool:
        """Whether a stop of all joints together keeps every conditional margin ≥ 0, or as it is.

        After `update`; see `CoordinatedStop` for what that is, and how closely it is looked at. Cut
        to `lower` and `upper`, that stop is what keeps them where it is the last one that is safe.

        Args:
            q_next, dq_next: (n,) state at the end of this period, from which the stop begins.
        """
        if self._stop is None or self._motion is None:
            return True
        return self._stop.is_safe(q_next, dq_next, self._motion.q)


def _joints_can(
    constraints: Sequence[Constraint], robot: RobotDescription, most: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Greatest speeds, and what joints can brake with, (n,) both, that all leave."""
    speed = np.array(robot.velocity)
    brake = np.minimum(robot.brake_acceleration, robot.setpoint_acceleration_max)
    brake = np.minimum(brake, most)
    for constraint in constraints:
        if constraint.speed_max is not None:
            np.minimum(speed, constraint.speed_max, out=speed)
        if constraint.acceleration_max is not None:
            np.minimum(brake, constraint.acceleration_max, out=brake)
    return speed, brake
