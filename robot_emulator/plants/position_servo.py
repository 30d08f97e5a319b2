"""Joints that follow positions, without a body behind them."""

from __future__ import annotations

import math
from typing import Any, Self

import numpy as np

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.config import PlantSettings
from hoap3.robot_emulator.plants.base import Plant


class PositionServo(Plant):
    """Joints that follow a position reference: at once, or with a first-order lag.

    With `encoder: counts` the measurement is what an int16 encoder shows, while the reference
    stays in double: rounding the reference itself would stop a slow motion.
    A servo knows no effort and no contact: `tau` and `wrench` are zero.
    """

    commands = ("position",)
    heeds = ("servo", "time_constant_ms", "encoder")

    def __init__(self, description: RobotDescription, settings: PlantSettings) -> None:
        from hoap3.robot_emulator.plants.motion_kernels import serve

        super().__init__(description, settings)
        self._serve = serve
        self._time_constant = settings.time_constant_ms * 1e-3 if settings.servo == "lag" else 0.0
        self._counts, self._position, self._followed = np.zeros((3, description.n))
        if settings.encoder == "counts":
            if description.counts_per_rad is None:
                raise DescriptionError(
                    f"robot {description.name!r} has no encoder scales: give each joint "
                    "`encoder_counts_per_rad`, or set plant.encoder to ideal"
                )
            self._counts[:] = description.counts_per_rad

    @classmethod
    def configured(
        cls, description: RobotDescription, settings: PlantSettings, parameters: Any, seed: int
    ) -> Self:
        """Make one of the keys of `plant`."""
        del parameters, seed
        return cls(description, settings)

    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,) [rad or m]."""
        self.start[:] = self._followed[:] = q
        self._serve(self._followed, 1.0, 1.0, self._counts, self._position, self.q, self.dq)
        self.dq[:] = 0.0

    def step(self, command: FloatArray, dt: float) -> None:
        """Follow the reference `command`, (n,) [rad or m], for `dt` [s]."""
        np.copyto(self._followed, command)
        self.hold(dt)

    def hold(self, dt: float) -> None:
        """Follow the last reference for `dt` [s]."""
        share = -math.expm1(-dt / self._time_constant) if self._time_constant else 1.0
        self._serve(self._followed, share, dt, self._counts, self._position, self.q, self.dq)
