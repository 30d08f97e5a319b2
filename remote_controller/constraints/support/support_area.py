"""The area that the soles on the ground span."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.errors import ConfigError, one_of
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.support.polygon import half_planes, hull, inset
from hoap3.remote_controller.model.kinematics import Kinematics

MOVED = 1e-3  # m: from here on a sole is not where the area was laid out


class SupportArea:
    """Convex hull of soles, seen from the first one, which lies flat on the ground, z up.

    It is laid out where the soles are at that moment, and stays until it is laid out again: a
    sole that carries must be kept still, as `fixed_frame` does.

    Args:
        description: of the robot.
        kinematics: of the robot.
        soles: their frames; none: the base frame's sole, else the robot's first.
        margin_m: by which every edge lies further in.

    Attributes:
        frame: number of the first sole's frame.
        rows: the most edges that there can be.
        normals: (rows, 2) unit, inwards, and
        offsets: (rows,) [m]: n·p ≥ offset inside; 0 and −inf for unused ones.

    Raises:
        ConfigError: the robot has no such sole, or nothing remains inside the margin.
    """

    def __init__(
        self,
        description: RobotDescription,
        kinematics: Kinematics,
        soles: tuple[str, ...],
        margin_m: float,
    ) -> None:
        outlines = {sole.frame: np.array(sole.polygon) for sole in description.soles}
        if not outlines:
            robot = f"robot {description.name!r} has no soles"
            raise ConfigError("", "soles", list(soles), robot, "Leave this constraint out")
        base = description.base_frame
        names = soles or (base if base in outlines else next(iter(outlines)),)
        for name in names:
            if name not in outlines:
                known = one_of(name, outlines, "Soles")
                raise ConfigError("", "soles", name, "is no sole of the robot", known)
        self._outlines = [outlines[name] for name in names]
        self._frames = [kinematics.frame_id(name) for name in names]
        self._margin = margin_m
        self.frame = self._frames[0]
        self.rows = sum(len(outline) for outline in self._outlines)
        self.normals, self.offsets = np.zeros((self.rows, 2)), np.full(self.rows, -np.inf)
        self._origins = np.zeros((len(names), 3))
        self._position, self._rotation = np.zeros(3), np.zeros((3, 3))
        self._jacobian = np.zeros((6, description.n))
        kinematics.update(description.initial_position)
        if not len(inset(self._corners(kinematics), margin_m)):
            left = "leaves nothing of the support polygon"
            raise ConfigError("", "margin_m", margin_m, left, "Write a smaller margin")

    def lay_out(self, kinematics: Kinematics) -> None:
        """Take the soles as they are now."""
        corners = hull(self._corners(kinematics))
        self.normals[:], self.offsets[:] = 0.0, -np.inf
        self.normals[: len(corners)], self.offsets[: len(corners)] = half_planes(corners)
        self.offsets += self._margin

    def has_moved(self, kinematics: Kinematics) -> bool:
        """Whether a sole is more than 1 mm from where it was laid out."""
        for sole, frame in enumerate(self._frames[1:], 1):
            kinematics.frame(frame, self.frame, self._position, self._rotation, self._jacobian)
            if np.abs(self._position - self._origins[sole]).max() > MOVED:
                return True
        return False

    def _corners(self, kinematics: Kinematics) -> FloatArray:
        """Corners of all soles on the first one's plane, (k, 2), and note where the soles are."""
        found = [self._outlines[0]]
        for sole, frame in enumerate(self._frames[1:], 1):
            kinematics.frame(frame, self.frame, self._position, self._rotation, self._jacobian)
            self._origins[sole] = self._position
            turned = self._outlines[sole] @ self._rotation[:2, :2].T
            found.append(turned + self._position[:2])
        return hull(np.concatenate(found))
