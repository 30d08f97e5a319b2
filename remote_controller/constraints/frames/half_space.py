"""A point on one side of a plane."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.constraints.barrier import Barrier
from hoap3.remote_controller.constraints.coordinated_stop import reach
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.model.motion import Motion

Triple = tuple[float, float, float]


class HalfSpace(Barrier):
    """n·p(q) ≥ offset [m] for a point p that is fixed to a frame; m(q) = n·p − offset.

    p, the unit normal n and the offset are as seen from the reference frame.
    """

    class Parameters(Barrier.Parameters):
        """Point and plane."""

        frame: str = Field(description="frame that the point is fixed to")
        point_m: Triple = Field((0.0, 0.0, 0.0), description="the point in that frame [m]")
        reference: str | None = Field(None, description="the plane's frame; none: the base frame")
        normal: Triple = Field(description="towards the allowed side, of any length")
        offset_m: float = Field(0.0, description="n·p of the plane, n of length 1 [m]")

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        super().prepare(parameters, kinematics)
        self._normal = unit(parameters.normal, "normal")
        self._offset = parameters.offset_m
        self._point = np.array(parameters.point_m)
        self._frame = kinematics.frame_id(parameters.frame)
        self._seen_from = kinematics.frame_id(parameters.reference or self.description.base_frame)
        self._position, self._rotation = np.zeros(3), np.zeros((3, 3))
        self._jacobian = np.zeros((6, self.n))
        self._arm, self._coefficients = np.zeros(3), np.zeros(6)
        self._drift, self._turn = np.zeros(6), np.zeros(3)
        self.name_rows((parameters.frame,))
        self.reach = reach(kinematics) + float(np.linalg.norm(self._point))

    def look(self, kinematics: Kinematics, margins_out: FloatArray, A_out: FloatArray) -> None:
        """Write m, and −n·dp/dt = −n·v − (r × n)·ω with r from the frame's origin to p."""
        kinematics.frame(
            self._frame, self._seen_from, self._position, self._rotation, self._jacobian
        )
        np.dot(self._rotation, self._point, out=self._arm)
        x, y, z = self._arm
        nx, ny, nz = self._normal
        margins_out[0] = self._normal @ self._position + self._normal @ self._arm - self._offset
        self._coefficients[:] = (
            *(-nx, -ny, -nz),
            *(z * ny - y * nz, x * nz - z * nx, y * nx - x * ny),
        )
        np.dot(self._coefficients, self._jacobian, out=A_out[0])

    def bend(self, motion: Motion, out: FloatArray) -> None:
        """Write −n·(p̈ where q̈ = 0): that of the origin, a_ω × r, and ω × (ω × r)."""
        motion.frame_drift(self._frame, self._seen_from, self._drift)
        np.dot(self._jacobian[3:], motion.dq, out=self._turn)
        wx, wy, wz = self._turn
        x, y, z = self._arm
        nx, ny, nz = self._normal
        along = wx * x + wy * y + wz * z
        square = wx * wx + wy * wy + wz * wz
        turning = nx * (wx * along - square * x)
        turning += ny * (wy * along - square * y) + nz * (wz * along - square * z)
        out[0] = self._coefficients @ self._drift - turning


def unit(vector: Triple, key: str) -> FloatArray:
    """A direction at length 1, (3,).

    Raises:
        ConfigError: it has no length.
    """
    direction = np.array(vector)
    largest = float(np.abs(direction).max())
    if largest == 0.0:
        raise ConfigError("", key, list(vector), "has no direction", "Write a vector, not 0")
    direction /= largest
    return np.asarray(direction / np.linalg.norm(direction))
