"""Lyapunov functions of a user that no joint can change."""

from __future__ import annotations

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction


class Clock(LyapunovFunction):
    """V = 1 + t: it rises, whatever the robot does."""

    def __init__(self, description: RobotDescription, kinematics: Kinematics, _: object) -> None:
        super().__init__(description.n)

    def update(self, kinematics: Kinematics, time_s: float) -> None:
        self.value, self.rate = 1.0 + time_s, 1.0
