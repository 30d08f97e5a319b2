"""A body whose joints take accelerations: ideal servos, with the torques that they need."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.plants.base import Plant


class AccelerationServo(Plant):
    """Joints that have exactly the acceleration of the command during each period.

    q(t+T) = q + T·dq + T²/2·ddq and dq(t+T) = dq + T·ddq. A joint that runs into a mechanical stop
    stays there, without rebound. `tau` is what the motors give, by inverse dynamics; nothing limits
    it, and there is neither friction nor contact.
    """

    commands = ("acceleration",)

    def __init__(self, description: RobotDescription, parameters: Settings | None = None) -> None:
        from hoap3.robot_emulator.plants.motion_kernels import advance

        super().__init__(description, parameters or self.Parameters())
        self._advance = advance
        self._stops = np.array(description.lower_hard), np.array(description.upper_hard)
        self._dynamics = Dynamics(description)
        self._still = np.zeros(description.n)

    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,) [rad or m]."""
        self.q[:] = self.start[:] = q
        self.hold(0.0)

    def step(self, command: FloatArray, dt: float) -> None:
        """Accelerate by `command`, (n,) [rad/s² or m/s²], for `dt` [s]."""
        self._advance(command, dt, True, *self._stops, self.q, self.dq)
        self._dynamics.inverse(self.q, self.dq, command, self.tau)

    def hold(self, dt: float) -> None:
        """Stand still: the brakes hold it."""
        del dt
        self.dq[:] = 0.0
        self._dynamics.inverse(self.q, self._still, self._still, self.tau)
