"""The centre of mass above the soles."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.barrier import Barrier
from hoap3.remote_controller.constraints.support.support_area import SupportArea
from hoap3.remote_controller.model.kinematics import Kinematics


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
        self._com, self._jacobian = np.zeros(3), np.zeros((3, self.n))
        self.events["sole_moved"] = 0

    def update(
        self, kinematics: Kinematics, state: State, A_out: FloatArray, b_out: FloatArray
    ) -> None:
        """Write one row for each edge."""
        area = self._area
        if not self._started:
            area.lay_out(kinematics)
        elif area.has_moved(kinematics):
            self.events["sole_moved"] += 1
        kinematics.com(area.frame, self._com, self._jacobian)
        np.dot(area.normals, self._com[:2], out=self.margins)
        self.margins -= area.offsets
        np.dot(area.normals, self._jacobian[:2], out=A_out)
        np.negative(A_out, out=A_out)
        self.limit(A_out, b_out)
