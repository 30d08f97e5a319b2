"""A controller of a user that is too slow now and then."""

from __future__ import annotations

import time
from typing import Any, Literal

from pydantic import Field

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.messages import FloatArray, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.base import Controller


def keep_busy(length_ns: int) -> None:
    end = time.monotonic_ns() + length_ns
    while time.monotonic_ns() < end:
        pass


class SlowSetpoint(Setpoint):
    """Takes `delay` [ns] to be stamped by the service, once."""

    def __setattr__(self, name: str, value: Any) -> None:
        super().__setattr__(name, value)
        if name == "stamp_received" and self.delay:
            keep_busy(self.delay)
            self.delay = 0


class Busy(Controller):
    """Holds the reference; every so many ticks a stage keeps the CPU busy for some time."""

    class Parameters(Settings):
        every: int = Field(500, gt=0)
        busy_ms: float = Field(2.0, gt=0)
        stage: Literal["solve", "encode"] = "solve"

    def __init__(self, description: RobotDescription, parameters: Parameters) -> None:
        super().__init__(description, parameters)
        self.command = SlowSetpoint(description.n)
        self.command.delay = 0

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        pass

    def step(self, state: State) -> Setpoint:
        self.command.stamp_kinematics = self.now()
        if state.mode == State.ACTIVE and state.tick % self.parameters.every == 0:
            delay = round(self.parameters.busy_ms * 1e6)
            if self.parameters.stage == "solve":
                keep_busy(delay)
            else:
                self.command.delay = delay
        self.command.values[:] = state.reference
        return self.command
