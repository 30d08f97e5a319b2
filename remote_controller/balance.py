"""Static balance: whether the centre of mass is above the soles that stand on the ground."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.support.polygon import half_planes, hull
from hoap3.remote_controller.model.kinematics import Kinematics

ON_GROUND_M = 1e-3  # height of a sole above the plane of the one that is fixed
LEAST_M = -1e-4  # of the distance to the edge: encoders round, and targets may be on the edge
FLAT = math.cos(math.radians(0.5))  # of the angle between both planes


class Balance:
    """Distance of the centre of mass, seen from above, to the edge of the support polygon.

    The fixed sole carries the robot. Other soles count while they are on its plane, to 1 mm and
    0.5 degrees; the polygon is then the convex hull of all of them.

    Args:
        description: of a robot whose base frame is one of its soles.

    Attributes:
        checked: postures that were looked at.
        outside: how many of them had the centre of mass outside, by more than 0.1 mm.
        least_m: smallest distance to the edge, negative outside [m]; inf before the first posture.
    """

    def __init__(self, description: RobotDescription) -> None:
        soles = {sole.frame: np.array(sole.polygon) for sole in description.soles}
        self._kinematics = kinematics = Kinematics(description)
        self._sole = hull(soles.pop(description.base_frame))
        self._base = kinematics.frame_id(description.base_frame)
        self._others = [(kinematics.frame_id(frame), polygon) for frame, polygon in soles.items()]
        self._normals, self._offsets = half_planes(self._sole)
        self._com, self._com_jacobian = np.zeros(3), np.zeros((3, description.n))
        self._position, self._rotation = np.zeros(3), np.zeros((3, 3))
        self._jacobian = np.zeros((6, description.n))
        self._distances = np.zeros(len(self._offsets))
        self.checked = self.outside = 0
        self.least_m = math.inf

    def look(self, q: FloatArray) -> None:
        """Take joint positions, (n,) [rad or m]; those that are not finite are left out."""
        kinematics = self._kinematics
        kinematics.update(q)
        kinematics.com(self._base, self._com, self._com_jacobian)
        np.dot(self._normals, self._com[:2], out=self._distances)
        self._distances -= self._offsets
        distance = float(self._distances.min())
        if distance < 0.0:
            distance = self._to_edge_of_all()
        if math.isfinite(distance):
            self.checked += 1
            self.outside += distance < LEAST_M
            self.least_m = min(self.least_m, distance)

    def as_json(self) -> dict[str, Any] | None:
        """What was found; None before the first posture."""
        if not self.checked:
            return None
        return {"checked": self.checked, "outside": self.outside, "least_m": self.least_m}

    def _to_edge_of_all(self) -> float:
        """Distance to the edge of all soles on the ground; `kinematics` is up to date."""
        corners = [self._sole]
        for frame, polygon in self._others:
            self._kinematics.frame(
                frame, self._base, self._position, self._rotation, self._jacobian
            )
            flat = self._rotation[2, 2] >= FLAT
            if flat and np.abs(polygon @ self._rotation[2, :2] + self._position[2]).max() <= (
                ON_GROUND_M
            ):
                corners.append(polygon @ self._rotation[:2, :2].T + self._position[:2])
        normals, offsets = half_planes(hull(np.concatenate(corners)))
        return float((normals @ self._com[:2] - offsets).min())


def balance_of(description: RobotDescription) -> Balance | None:
    """Balance of a robot that stands on a fixed sole; None where its base is anything else."""
    stands = any(sole.frame == description.base_frame for sole in description.soles)
    return Balance(description) if stands else None
