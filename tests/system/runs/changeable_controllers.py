"""Controllers of a user that can be changed while they run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.base import VelocityController

FASTEST = 0.01  # rad/s


class Turner(VelocityController):
    """Turns every joint at one speed, which can be changed [rad/s]; 0 at first."""

    def __init__(self, description: RobotDescription, parameters: Settings) -> None:
        super().__init__(description, parameters)
        self.u = np.zeros(description.n)

    def velocity(self, state: State) -> FloatArray:
        return self.u

    def change(self, request: Mapping[str, Any]) -> None:
        speed = request.get("speed")
        if set(request) != {"speed"} or not isinstance(speed, float) or abs(speed) > FASTEST:
            raise UsageError(f"{dict(request)}: give a speed of at most {FASTEST} rad/s")
        self.u[:] = speed

    def changeable(self) -> dict[str, Any]:
        return {"speed": float(self.u[0])}


class Faulty(Turner):
    """Has a mistake in it."""

    def change(self, request: Mapping[str, Any]) -> None:
        self.u[:] = 1.0 / len(request["none"])
