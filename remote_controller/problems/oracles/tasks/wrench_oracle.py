"""A task that controls a wrench along some directions, from the first contact on.

Liu, Tan and Padois (2015), (3), by `wrench_reference`. Its memory, the contact and the integral of
the wrench error, starts with the reset.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import (
    ROUNDING,
    AccelerationTask,
    PositionTask,
    TaskRows,
    place_target_of,
    root_pose,
    stack_rows,
)
from hoap3.remote_controller.problems.oracles.tasks.live_oracle import live_wrench_of
from hoap3.remote_controller.problems.oracles.tasks.logarithm_oracle import (
    rotation_of,
    rotation_vector,
)
from hoap3.remote_controller.tasks.accelerations import wrench_reference as reference

Array = NDArray[np.float64]
Settings = Mapping[str, Any]

AXES = ("x", "y", "z", "rx", "ry", "rz")
NEAR = (
    0.9  # cosine, above which the reference's x is too near to a normal to define the contact's x
)
USUAL: dict[str, Any] = {
    "force_kp": 0.0,
    "force_ki_per_s": 5.0,
    "force_kd": 0.0,
    "touch_n": 0.5,
}


class WrenchTask(AccelerationTask):
    """A frame with a target in the root's axes, with or without orientation, and a wrench.

    Args:
        given: parameters of the task.
        robot: its kinematics.

    Attributes:
        sensor: the frame whose wrench is measured.
        kept: the directions along which the wrench is controlled.
        touches: whether it is, since there was contact.
        measured: the wrench along them, (k,) [N, N m].

    Raises:
        UnverifiableError: the robot has no such sensor.
    """

    def __init__(self, given: Settings, robot: Robot) -> None:
        description, self._given = robot.description, {**USUAL, **given}
        self.frame, self.sensor = given["frame"], given.get("sensor") or given["frame"]
        if self.sensor not in description.wrench_sensors:
            raise UnverifiableError("the robot has no wrench sensor there")
        standing = given.get("reference") or description.base_frame
        self._place = PositionTask(
            place_target_of(given.get("target"), robot), self.frame, standing, robot
        )
        robot.place(description.initial_position)
        _, axes = root_pose(robot, standing)
        turn = given.get("rotation_rad")
        simple = given.get("force_n") is not None
        self.kept = ["z"] if simple else list(given["axes"])
        wanted = [given["force_n"]] if simple else given["wrench"]
        self._oriented = turn is not None or any(axis in AXES[3:] for axis in self.kept)
        written = turn is not None and turn != "hold"
        self._turn = axes @ rotation_of(np.array(turn, float)) if written else None
        self._held = self._oriented and not written
        m = 6 if self._oriented else 3
        contact = _contact_axes(given, axes)
        rows = {axis: np.zeros(6) for axis in AXES}
        for place, axis in enumerate(AXES):
            rows[axis][3 * (place // 3) : 3 * (place // 3) + 3] = contact[:, place % 3]
        self._S = np.array([rows[axis][:m] for axis in self.kept])
        others = [rows[axis] for axis in AXES if axis not in self.kept] if self._oriented else []
        self._P = np.array(others).reshape(-1, m)
        self._wanted = np.array(wanted, float)
        self._most = np.array(given.get("integral_max") or self._greatest(), float)
        self._begins, steered = self._wanted, given.get("wrench_target")
        torques = [axis in AXES[3:] for axis in self.kept]
        self._steered = steered and live_wrench_of(steered, robot.messages, torques)
        along = self._wanted @ self._S[:, :3]
        self._along = along / np.linalg.norm(along) if along.any() else along
        self.touches = False
        self.measured, self._integral = np.zeros((2, len(self.kept)))

    def begin(self, robot: Robot, time_s: float) -> None:
        """Start; there is no contact yet."""
        self._place.begin(robot, time_s)
        if self._steered is not None:
            self._steered.start(self._begins, time_s)
        if self._held:
            _, self._turn = root_pose(robot, self.frame)
        self._forget()

    def at(self, robot: Robot, dq: Array, time_s: float, period_s: float) -> TaskRows:
        """Evaluate the position and, below it, φ with exp[φ] = R_d Rᵀ in the root's axes."""
        place = self._place.at(robot, dq, time_s, period_s)
        if not self._oriented or self._turn is None:
            return place
        J, twist, drift = (each[3:] for each in robot.frame_motion(self.frame, own_axes=False))
        _, R = root_pose(robot, self.frame)
        phi, speed = rotation_vector(self._turn @ R.T), np.abs(J) @ np.abs(dq)
        off = np.array([np.full(3, 4.0), speed, np.abs(dq).max() * speed])
        below = TaskRows(J, phi, twist, drift, -phi, ROUNDING * off)
        return stack_rows([place, below])

    def feel(
        self, robot: Robot, wrench: Array, absent: float, time_s: float, period_s: float
    ) -> None:
        """Fold a measurement, once for each State.

        Args:
            robot: placed.
            wrench: of the sensor, (6,).
            absent: share by which the task is out, α_ii.
            time_s, period_s: [s].
        """
        if self._steered is not None:
            self._wanted, _ = self._steered.at(time_s)
        if absent >= 1.0:
            self._forget()
        place, axes = root_pose(robot, self.sensor)
        origin, _ = root_pose(robot, self.frame)
        f = reference.wrench_about(axes, wrench, place, origin)
        self.measured = self._S @ f[: self._S.shape[1]]
        some = self._along.any()
        pressed = float(self._along @ f[:3]) if some else float(np.linalg.norm(f[:3]))
        felt = pressed >= self._given["touch_n"] and absent < 1.0
        self.touches = self.touches or felt
        if felt and absent <= 0.0:
            grown = self._given["force_ki_per_s"] * period_s * (self._wanted - self.measured)
            self._integral = np.clip(self._integral + grown, -self._most, self._most)

    def press(self, rows: TaskRows, wanted: Array, M: Array) -> tuple[TaskRows, Array]:
        """Replace the desired acceleration along S by that of the wrench, (3).

        Args:
            rows, wanted: of the pose.
            M: (n, n).
        """
        given, S = self._given, self._S
        w = reference.aimed(self._wanted, self.measured, given["force_kp"], self._integral)
        inverse = reference.inverse_task_inertia(M, rows.jacobian, S, self._P)
        desired = reference.wanted_acceleration(
            S, inverse, self.measured - w, given["force_kd"], rows.motion, self._drift(rows), wanted
        )
        across = np.eye(S.shape[1]) - S.T @ S
        error = across @ rows.error
        return rows._replace(error=error, motion=across @ rows.motion, slope=-error), desired

    def _drift(self, rows: TaskRows) -> Array:
        """J̇·dq: ν̇₀ without the target's acceleration."""
        found = rows.rate.copy()
        found[:3] += self._place.acceleration
        return found

    def _forget(self) -> None:
        self.touches = False
        self._integral = np.zeros(len(self.kept))

    def _greatest(self) -> list[float]:
        """Limits of the integral: the largest desired force, or torque, for each direction."""
        turning = np.array([axis in AXES[3:] for axis in self.kept])
        size = np.abs(self._wanted)
        return [float(size[turning == kind].max()) for kind in turning]


def columns_of(task: WrenchTask, name: str) -> list[str]:
    """Return the names of the log's columns of the measured wrench."""
    first, *others = task.kept
    start = f"wrench_{name}_{first}" if first in AXES[3:] else f"force_{name}"
    return [start, *(f"wrench_{name}_{axis}" for axis in others)]


def _contact_axes(given: Settings, reference_axes: Array) -> Array:
    """Return the contact's axes as columns, (3, 3), in the root; z is a normal if one is given."""
    if given.get("normal") is None:
        turn = given.get("axes_rad") or np.zeros(3)
        return np.asarray(reference_axes @ rotation_of(np.array(turn, float)), float)
    z = reference_axes @ np.array(given["normal"], float)
    z = z / np.linalg.norm(z)
    near = abs(reference_axes[:, 0] @ z) > NEAR
    y = np.cross(z, reference_axes[:, 1 if near else 0])
    y = y / np.linalg.norm(y)
    return np.column_stack([np.cross(y, z), y, z])
