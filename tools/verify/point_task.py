"""The point that a controller brings to a target: its error and Jacobian by Pinocchio."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import COM, RobotDescription
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.oracles.robot_oracle import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PointTask:
    """e = p(q) − p_d of the centre of mass, or of a frame's origin [m].

    Attributes:
        robot: its kinematics.
        point: a frame, or `com`.
        reference: the frame that it is seen from.
        target: p_d, (3,) [m].
    """

    robot: Robot
    point: str
    reference: str
    target: Array

    @classmethod
    def of(cls, description: RobotDescription, parameters: Mapping[str, Any]) -> PointTask:
        """Return the task of a config, which the robot's default task completes.

        Raises:
            UnverifiableError: neither has a target.
        """
        default, robot = description.default_task, Robot(description)
        reference = parameters.get("reference_frame") or (default.reference if default else None)
        point = parameters.get("point") or (default.point if default else None)
        if point is None or reference is None:
            raise UnverifiableError("the log names no target")
        target = parameters.get("target_m") or (default.target_m if default else None)
        task = cls(robot, point, reference, np.zeros(3))
        if target is None:
            if default is None or default.move_m is None:
                raise UnverifiableError("the log names no target")
            start, _ = task.at(description.initial_position)
            target = start + np.array(default.move_m)
        return cls(robot, point, reference, np.array(target, float))

    def at(self, q: Array) -> tuple[Array, Array]:
        """Error e (3,) [m] and J (3, n) [m/rad] at joint positions q, (n,)."""
        self.robot.place(q)
        if self.point == COM:
            p, J = self.robot.com(self.reference)
        else:
            p, _, J = self.robot.frame(self.point, self.reference)
        return p - self.target, J[:3]
