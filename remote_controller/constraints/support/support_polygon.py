"""The centre of mass above the soles."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.constraints.barrier import Barrier
from hoap3.remote_controller.constraints.support.support_area import SupportArea
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.model.motion import Motion


class SupportPolygon(Barrier):
    """Centre of mass, projected on the ground, inside the support polygon less a margin [m].

    With n·p ≥ o for each edge, m(q) = n·c(q) − o − margin, in the first sole's frame. The area
    is laid out at the first update after a reset; the event `sole_moved` counts the updates in
    which another sole was elsewhere by more than 1 mm.
    """

    class Parameters(Barrier.Parameters):
        """Soles and margin."""

        soles: tuple[str, ...] = Field(
            (), description="frames of the soles on the ground; none: the base frame's"
        )
        margin_m: float = Field(0.0, ge=0, description="kept to every edge [m]")

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        super().prepare(parameters, kinematics)
        self._area = SupportArea(
            self.description, kinematics, parameters.soles, parameters.margin_m
        )
        self.name_rows(tuple(f"edge {edge}" for edge in range(self._area.rows)))
        self._com, self._drift, self._jacobian = np.zeros(3), np.zeros(3), np.zeros((3, self.n))
        self.events["sole_moved"] = 0

    def begin(self, kinematics: Kinematics) -> None:
        """Lay out the area where the soles are."""
        self._area.lay_out(kinematics)

    def look(self, kinematics: Kinematics, margins_out: FloatArray, A_out: FloatArray) -> None:
        """Write n·c − o − margin and −n·J for each edge."""
        area = self._area
        kinematics.com(area.frame, self._com, self._jacobian)
        np.dot(area.normals, self._com[:2], out=margins_out)
        margins_out -= area.offsets
        np.dot(area.normals, self._jacobian[:2], out=A_out)
        np.negative(A_out, out=A_out)

    def judge(self, kinematics: Kinematics) -> None:
        """Count whether another sole is elsewhere."""
        if self._started and self._area.has_moved(kinematics):
            self.events["sole_moved"] += 1

    def bend(self, motion: Motion, out: FloatArray) -> None:
        """Write −n·J̇·q̇ of the centre of mass for each edge."""
        motion.com_drift(self._area.frame, self._drift)
        np.dot(self._area.normals, self._drift[:2], out=out)
        np.negative(out, out=out)
