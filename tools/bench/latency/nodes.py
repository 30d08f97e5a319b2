"""The controller of a measurement of the link: it computes nothing."""

from __future__ import annotations

from hoap3.protocol.messages import FloatArray, Setpoint, State
from hoap3.remote_controller.controllers.base import Controller


class NullController(Controller):
    """Holds the robot where it is, with what it sent itself: the same bytes both ways, no work."""

    commands = ("position", "acceleration", "torque")

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Nothing to begin with."""

    def step(self, state: State) -> Setpoint:
        """Answer with the reference; with what the motors give, or with no acceleration."""
        command = self.command
        command.stamp_kinematics = self.now()
        if self.kind == "position":
            command.values[:] = state.reference
        elif self.kind == "torque" and self.description.gravity == "full":
            command.values[:] = state.tau
        return command
