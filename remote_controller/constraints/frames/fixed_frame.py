"""A frame that stays where it is."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import Constraint, Guarantee, Level
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.model.motion import Motion

Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
AXES: tuple[Axis, ...] = ("x", "y", "z", "rx", "ry", "rz")


class FixedFrame(Constraint):
    """J·u = −η·e on the chosen axes: a frame keeps the pose that it had at the first update.

    J and the error e are as seen from the reference frame, in its axes: e is the displacement [m]
    and the rotation vector, as long as it is small [rad]. η = 0 gives J·u = 0, which Euler steps
    of length T leave by about |d²x/dt²|·T²/2 each; with η > 0 the error stays near
    |d²x/dt²|·T/(2η) instead. `drift` is the largest |e|. Choose no more axes than the joints
    between both frames can move: equations that ask for more have no answer once e ≠ 0.

    For accelerations J·q̈ = −J̇·q̇ − 2η·J·q̇ − η²·e, with ηT ≤ 0.6; the error then stays near
    |d³x/dt³|·T/(2η²).
    """

    class Parameters(Constraint.Parameters):
        """Frame, reference and axes."""

        frame: str = Field(description="what stays still")
        reference: str | None = Field(None, description="seen from; none: the base frame")
        axes: tuple[Axis, ...] = Field(AXES, min_length=1, description="x, y, z, rx, ry, rz")
        eta_per_s: float = Field(
            10.0, ge=0, description="rate at which drift is corrected, at most 1/period [1/s]"
        )

    equality = True
    levels: ClassVar[tuple[Level, ...]] = ("velocity", "acceleration")
    guarantee: ClassVar[Guarantee] = "bounded drift"

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        self.check_rate(parameters.eta_per_s)
        self._eta = parameters.eta_per_s
        self._frame = kinematics.frame_id(parameters.frame)
        self._seen_from = kinematics.frame_id(parameters.reference or self.description.base_frame)
        self._axes = np.array([AXES.index(axis) for axis in dict.fromkeys(parameters.axes)])
        self.rows = len(self._axes)
        self.names = tuple(f"{parameters.frame} {AXES[axis]}" for axis in self._axes)
        self._position, self._rotation = np.zeros(3), np.zeros((3, 3))
        self._position_kept, self._rotation_kept = np.zeros(3), np.zeros((3, 3))
        self._jacobian, self._error = np.zeros((6, self.n)), np.zeros(6)
        self._drift = 0.0

    def update(
        self, kinematics: Kinematics, state: State, A_out: FloatArray, b_out: FloatArray
    ) -> None:
        """Write one equation for each axis."""
        self._measure(kinematics)
        A_out[:] = self._jacobian[self._axes]
        b_out[:] = self._error[self._axes]
        self._drift = float(np.abs(b_out).max())
        b_out *= -self._eta
        self.watch()

    def prepare_accelerations(self, speed: FloatArray, deceleration: FloatArray) -> None:
        """Fit η to the period."""
        self._eta = self.fit_rate(self.parameters, speed, np.full(self.n, np.inf))
        self._bend, self._rates = np.zeros(6), np.zeros(6)

    def update_accelerations(
        self,
        motion: Motion,
        state: State,
        G_out: FloatArray,
        lower_out: FloatArray,
        upper_out: FloatArray,
    ) -> None:
        """Write one equation for each axis."""
        self._measure(motion.kinematics)
        np.dot(self._jacobian, motion.dq, out=self._rates)
        motion.frame_drift(self._frame, self._seen_from, self._bend)
        self._rates *= 2.0 * self._eta
        self._bend += self._rates
        G_out[:] = self._jacobian[self._axes]
        upper_out[:] = self._error[self._axes]
        self._drift = float(np.abs(upper_out).max())
        upper_out *= -self._eta * self._eta
        upper_out -= self._bend[self._axes]
        lower_out[:] = upper_out
        self.watch()

    def _measure(self, kinematics: Kinematics) -> None:
        """Find J and e."""
        kinematics.frame(
            self._frame, self._seen_from, self._position, self._rotation, self._jacobian
        )
        if not self._started:
            self._position_kept[:], self._rotation_kept[:] = self._position, self._rotation
        turned = self._rotation @ self._rotation_kept.T
        np.subtract(self._position, self._position_kept, out=self._error[:3])
        self._error[3] = (turned[2, 1] - turned[1, 2]) / 2
        self._error[4] = (turned[0, 2] - turned[2, 0]) / 2
        self._error[5] = (turned[1, 0] - turned[0, 1]) / 2

    def drift(self) -> float:
        """Largest |e| of the last update [m or rad]."""
        return self._drift
