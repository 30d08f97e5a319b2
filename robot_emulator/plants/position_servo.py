"""The plant: what the robot's body does with the reference that it is given."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.messages import FloatArray
from hoap3.robot_emulator.config import PlantSettings


class Plant(Protocol):
    """A body that advances by one period at a time.

    Attributes:
        q: measured positions, (n,), rad or m.
        dq: measured velocities, (n,), rad/s or m/s.
        tau: measured efforts, (n,), N m or N.
        wrench: fx fy fz tx ty tz of each of the description's wrench sensors, N and N m.
    """

    q: FloatArray
    dq: FloatArray
    tau: FloatArray
    wrench: FloatArray

    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,)."""

    def step(self, command: FloatArray, dt: float) -> None:
        """Advance by `dt` [s] under `command`, (n,)."""

    def hold(self, dt: float) -> None:
        """Advance by `dt` [s] at rest, or coming to rest: nobody commands."""


class PositionServo:
    """Joints that follow a position reference: at once, or with a first-order lag.

    With `encoder: counts` the measurement is what an int16 encoder shows, while the reference
    stays in double: rounding the reference itself lets a slow motion stall (docs/concepts.md).
    A servo knows no effort and no contact: `tau` and `wrench` are zero.
    """

    def __init__(self, description: RobotDescription, settings: PlantSettings) -> None:
        from hoap3.robot_emulator.plants.motion_kernels import serve

        self._serve = serve
        self._time_constant = settings.time_constant_ms * 1e-3 if settings.servo == "lag" else 0.0
        rows = np.zeros((6, description.n))
        self._counts, self._position, self._followed, self.q, self.dq, self.tau = rows
        if settings.encoder == "counts":
            if description.counts_per_rad is None:
                raise DescriptionError(
                    f"robot {description.name!r} has no encoder scales: give each joint "
                    "`encoder_counts_per_rad`, or set plant.encoder to ideal"
                )
            self._counts[:] = description.counts_per_rad
        self.wrench = np.zeros(6 * len(description.wrench_sensors))

    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,) [rad or m]."""
        self._followed[:] = q
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
