"""The controller of a measurement of the link: it computes nothing."""

from __future__ import annotations

from protocol.messages import FloatArray, Setpoint, State
from remote_controller.controllers.controller import Controller


class NullController(Controller):
    """Holds the reference that the robot applies: the same bytes both ways, and no work."""

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Nothing to begin with."""

    def step(self, state: State) -> Setpoint:
        """Answer with the reference."""
        command = self.command
        command.stamp_kinematics = self.now()
        command.values[:] = state.reference
        return command
