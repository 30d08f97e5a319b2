"""A frame that stays where it is."""

from __future__ import annotations

import math
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

    e is the displacement [m] and, of the rotation by θ about a unit axis a, sin θ·a: the rotation
    vector as long as it is small [rad]. Both are as seen from the reference frame, in its axes.
    J = ∂e/∂q, so that e stays where it is also while the frame turns about axes that are not kept,
    by less than half a turn. `drift` is the largest |e|. Choose no more axes than the joints
    between both frames can move: equations that ask for more have no answer once e ≠ 0.

    A period T with u leads to (1 − ηT)·e, but for c·T²/2 with c ≥ |d²e/dt²| at that u. So with
    0 < ηT ≤ 1 it stays |e| ≤ c·T/(2η); with η = 0 what periods lose adds up.

    For accelerations J·q̈ = −J̇·q̇ − 2η·ė − η²·e, with ηT ≤ 0.6. A period with q̈ leads e and ė on
    as if ë were constant, but for c·T³/6 and c·T²/2 with c ≥ |d³e/dt³| at that q̈. What either adds
    to e later on has its sign, as the eigenvalues λ₁ > |λ₂| of a period are real. So a frame that
    starts at rest stays within the sum of it, |e| ≤ (c·T/η²)·(1/2 − ηT/6) < c·T/(2η²).

    This holds while the equations do: a robot that stops for another constraint lets go of them,
    and takes back at rate η what they lost meanwhile.
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
        from hoap3.remote_controller.constraints.frames.fixed_frame_kernels import kept_rows

        self._kept_rows = kept_rows
        self._eta = self.rate_of(parameters)
        self._frame = kinematics.frame_id(parameters.frame)
        self._seen_from = kinematics.frame_id(parameters.reference or self.description.base_frame)
        self._axes = np.array([AXES.index(axis) for axis in dict.fromkeys(parameters.axes)])
        self.rows = len(self._axes)
        self.names = tuple(f"{parameters.frame} {AXES[axis]}" for axis in self._axes)
        self._position, self._rotation = np.zeros(3), np.zeros((3, 3))
        self._position_kept, self._rotation_kept = np.zeros(3), np.zeros((3, 3))
        self._jacobian, self._drift = np.zeros((6, self.n)), 0.0

    def update(
        self, kinematics: Kinematics, state: State, A_out: FloatArray, b_out: FloatArray
    ) -> None:
        """Write one equation for each axis."""
        self._write(kinematics, self._eta, A_out, b_out)
        self.watch(math.inf)

    def prepare_accelerations(self, speed: FloatArray, deceleration: FloatArray) -> None:
        """Fit η to the period."""
        self._eta = self.rate_of(self.parameters, (speed, np.full(self.n, np.inf)))
        self._bend = np.zeros(6)

    def update_accelerations(
        self,
        motion: Motion,
        state: State,
        G_out: FloatArray,
        lower_out: FloatArray,
        upper_out: FloatArray,
    ) -> None:
        """Write one equation for each axis."""
        self._write(motion.kinematics, self._eta * self._eta, G_out, upper_out)
        motion.frame_drift(self._frame, self._seen_from, self._bend)
        turned, omega = self._rotation @ self._rotation_kept.T, self._jacobian[3:] @ motion.dq
        turning = _slope(_cross(omega) @ turned)
        self._bend[3:] = _slope(turned) @ self._bend[3:] + turning @ omega
        upper_out -= 2.0 * self._eta * (G_out @ motion.dq) + self._bend[self._axes]
        lower_out[:] = upper_out
        self.watch(math.inf)

    def _write(
        self, kinematics: Kinematics, rate: float, A_out: FloatArray, b_out: FloatArray
    ) -> None:
        """Write ∂e/∂q and −rate·e of the axes."""
        kinematics.frame(
            self._frame, self._seen_from, self._position, self._rotation, self._jacobian
        )
        if not self._started:
            self._position_kept[:], self._rotation_kept[:] = self._position, self._rotation
        self._drift = self._kept_rows(
            self._position,
            self._rotation,
            self._position_kept,
            self._rotation_kept,
            self._jacobian,
            self._axes,
            rate,
            A_out,
            b_out,
        )

    def drift(self) -> float:
        """Largest |e| of the last update [m or rad]."""
        return self._drift


def _slope(turned: FloatArray) -> FloatArray:
    """S(R) = (tr R·I − R)/2: where Ṙ = ω × R, e = sin θ·a has ė = S(R)·ω, ë = S(R)·ω̇ + S(Ṙ)·ω.

    For 2e is the vector of [ω]×R + Rᵀ[ω]×, and that is (tr R·I − R)·ω of any matrix R.
    """
    found: FloatArray = -0.5 * turned
    found.flat[::4] += 0.5 * (turned[0, 0] + turned[1, 1] + turned[2, 2])
    return found


def _cross(omega: FloatArray) -> FloatArray:
    """[ω]×, (3, 3)."""
    x, y, z = omega
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
