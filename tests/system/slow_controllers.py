"""A controller of a user that is too slow now and then."""

from __future__ import annotations

import time

from pydantic import Field

from protocol.messages import FloatArray, Setpoint, State
from protocol.settings import Settings
from remote_controller.controllers.controller import Controller


class Busy(Controller):
    """Holds the reference; every so many ticks its step keeps the CPU busy for some time."""

    class Parameters(Settings):
        every: int = Field(500, gt=0)
        busy_ms: float = Field(2.0, gt=0)

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        pass

    def step(self, state: State) -> Setpoint:
        self.command.stamp_kinematics = self.now()
        if state.mode == State.ACTIVE and state.tick % self.parameters.every == 0:
            end = time.monotonic_ns() + round(self.parameters.busy_ms * 1e6)
            while time.monotonic_ns() < end:
                pass
        self.command.values[:] = state.reference
        return self.command
