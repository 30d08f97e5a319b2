"""The plant: what the robot's body does with the reference that it is given."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from protocol.description import RobotDescription
from protocol.errors import DescriptionError
from protocol.messages import FloatArray
from robot_emulator.config import PlantSettings

INT16 = np.iinfo(np.int16)


class Plant(Protocol):
    """A body that advances by one period at a time.

    Attributes:
        q: measured positions, (n,), rad or m.
        dq: measured velocities, (n,), rad/s or m/s.
        tau: measured efforts, (n,), N m or N.
    """

    q: FloatArray
    dq: FloatArray
    tau: FloatArray

    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,)."""

    def step(self, command: FloatArray, dt: float) -> None:
        """Advance by `dt` [s] under `command`, (n,)."""


class PositionServo:
    """Joints that follow a position reference: at once, or with a first-order lag.

    With `encoder: counts` the measurement is what an int16 encoder shows, while the reference
    stays in double: rounding the reference itself lets a slow motion stall (docs/concepts.md).
    A servo knows no effort: `tau` is zero.
    """

    def __init__(self, description: RobotDescription, settings: PlantSettings) -> None:
        self._time_constant = settings.time_constant_ms * 1e-3 if settings.servo == "lag" else 0.0
        self._counts = description.counts_per_rad if settings.encoder == "counts" else None
        if settings.encoder == "counts" and self._counts is None:
            raise DescriptionError(
                f"robot {description.name!r} has no encoder scales: give each joint "
                "`encoder_counts_per_rad`, or set plant.encoder to ideal"
            )
        self._position = np.zeros(description.n)
        self._before = np.zeros(description.n)
        self.q = np.zeros(description.n)
        self.dq = np.zeros(description.n)
        self.tau = np.zeros(description.n)

    def reset(self, q: FloatArray) -> None:
        """Be at rest at `q`, (n,) [rad or m]."""
        self._position[:] = q
        self.dq[:] = 0.0
        self._measure()

    def step(self, command: FloatArray, dt: float) -> None:
        """Follow the reference `command`, (n,) [rad or m], for `dt` [s]."""
        self._before[:] = self.q
        if self._time_constant:
            share = -math.expm1(-dt / self._time_constant)
            self._position += share * (command - self._position)
        else:
            self._position[:] = command
        self._measure()
        np.subtract(self.q, self._before, out=self.dq)
        self.dq /= dt

    def _measure(self) -> None:
        if self._counts is None:
            self.q[:] = self._position
        else:
            np.multiply(self._position, self._counts, out=self.q)
            np.rint(self.q, out=self.q)
            np.clip(self.q, INT16.min, INT16.max, out=self.q)
            self.q /= self._counts
