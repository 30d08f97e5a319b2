"""The zero-moment point inside the soles, after the cart-table model."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.constraints.support.com_motion import ComMotion
from hoap3.remote_controller.constraints.support.support_area import SupportArea
from hoap3.remote_controller.model.kinematics import Kinematics

LEAST_HEIGHT = 1e-3  # m: of the centre of mass above the sole


class Zmp(ComMotion):
    """p = c − (z/g)·c̈ inside the support polygon less a margin [m].

    Linear in c̈: for each edge n·p ≥ o, n·c̈ ≤ (g/z)(n·c − o), in the first sole's frame, z up, with
    c̈ as `ComMotion` has it. The mass is taken as a point whose height changes slowly (Kajita's
    cart-table). The margin is that of the ZMP which the last period really had, n·p − o.

    Nothing here makes sure that a fast centre of mass can still stop inside: limit speeds, or add
    `support_polygon`.
    """

    margin_unit = "m"

    class Parameters(ComMotion.Parameters):
        """Soles, margin and gravity."""

        soles: tuple[str, ...] = Field(
            (), description="frames of the soles on the ground; none: the base frame's"
        )
        margin_m: float = Field(0.005, ge=0, description="kept to every edge [m]")

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        super().prepare(parameters, kinematics)
        self._area = SupportArea(
            self.description, kinematics, parameters.soles, parameters.margin_m
        )
        edges = tuple(f"edge {edge}" for edge in range(self._area.rows))
        self.name_rows(edges, self._area.frame)
        self.events.update(sole_moved=0, too_low=0)
        self._zmp = np.zeros(2)

    def begin(self, kinematics: Kinematics) -> None:
        """Lay out the area where the soles are."""
        self._area.lay_out(kinematics)

    def look_around(self, kinematics: Kinematics) -> None:
        """Count whether another sole is elsewhere."""
        if self._area.has_moved(kinematics):
            self.events["sole_moved"] += 1

    def judge(self, com: FloatArray, change: FloatArray) -> None:
        """Write n·p − o with p = c − (z/g)·c̈."""
        self._zmp[:] = com[:2]
        self._zmp -= com[2] / (self._gravity * self.period_s) * change[:2]
        np.dot(self._area.normals, self._zmp, out=self.margins)
        self.margins -= self._area.offsets

    def limit(self, A_out: FloatArray, b_out: FloatArray, T: float) -> bool:
        """Write n·J ≤ (gT/z)(n·c − o), unless the centre of mass is on the ground."""
        area = self._area
        if self.com[2] < LEAST_HEIGHT:
            self.events["too_low"] += 1
            A_out[:], b_out[:] = 0.0, np.inf
            return False
        np.dot(area.normals, self.com[:2], out=b_out)
        b_out -= area.offsets
        b_out *= self._gravity * T / self.com[2]
        np.dot(area.normals, self.jacobian[:2], out=A_out)
        return True

    def of(self, motion: FloatArray) -> FloatArray:
        """n·c̈."""
        found: FloatArray = self._area.normals @ motion[:2]
        return found
