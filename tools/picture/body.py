"""A robot that can be put into postures, as faces in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.tools.picture.painter import Face
from hoap3.tools.picture.poses import Poses
from hoap3.tools.picture.solids import Solid, faces_of, solids_of

SIDES = (32, 24, 16, 12, 8, 4)  # of what is round; the first that there is room for


@dataclass(frozen=True, eq=False)
class Placement:
    """Where the frames of a robot are in the world.

    Attributes:
        origins: (links, 3) [m], in the order of `RobotDescription.frames`.
        rotations: (links, 3, 3), their columns are the frames' axes.
        frames: places of the frames in these, by name.
    """

    origins: FloatArray
    rotations: FloatArray
    frames: dict[str, int]

    def to_world(self, frame: str, points: FloatArray) -> FloatArray:
        """Points, (…, 3) [m], that are given in a frame."""
        place = self.frames[frame]
        return np.asarray(points @ self.rotations[place].T + self.origins[place])


class Body:
    """A robot, with what it looks like.

    The world is that of a free base where there is one; else its origin and axes are those of the
    description's `base_frame`, which is fixed to the ground.

    Args:
        description: of the robot.
        most: so many faces at the most, of which about half can be seen at a time. What is round
            gets fewer sides, then small shapes are left out, until it has no more.
        solids: what it looks like; the shapes of its URDF by default.

    Attributes:
        solids: those of its shapes that are drawn.
        left_out: how many are not.
        bones: of each joint, places of its parent and its child in `RobotDescription.frames`.

    Raises:
        DescriptionError: Pinocchio cannot build the model.
    """

    def __init__(
        self, description: RobotDescription, most: int = 2000, solids: list[Solid] | None = None
    ) -> None:
        self._poses = Poses(description)
        self._frames = {name: place for place, name in enumerate(description.frames)}
        shapes = solids_of(description) if solids is None else solids
        self.solids, self._faces = _within(shapes, most)
        self.left_out = len(shapes) - len(self.solids)
        self.bones = [
            (self._frames[joint.parent], self._frames[joint.child])
            for joint in description.structure.joints
        ]

    def place(self, q: FloatArray, base: FloatArray | None = None) -> Placement:
        """Where all frames are.

        Args:
            q: (n,) joint positions [rad or m].
            base: of a free base x y z [m] and a quaternion x y z w, as `State.base` begins, or
                None or nothing.
        """
        self._poses.update(q, base)
        placed = [self._poses.placement(name) for name in self._poses.links]
        origins = np.array([each.translation for each in placed])
        return Placement(origins, np.array([each.rotation for each in placed]), self._frames)

    def points(self, placement: Placement) -> FloatArray:
        """Every corner of a face, and every origin of a frame, in the world, (m, 3) [m]."""
        corners = [face.corners for face in self.faces(placement)]
        return np.concatenate((placement.origins, *corners))

    def faces(self, placement: Placement) -> list[Face]:
        """Every face in the world; its `index` says which of `solids` it belongs to."""
        return [
            Face(placement.to_world(solid.link, face.corners), face.outlined, index)
            for index, (solid, faces) in enumerate(zip(self.solids, self._faces, strict=True))
            for face in faces
        ]


def _within(solids: list[Solid], most: int) -> tuple[list[Solid], list[list[Face]]]:
    """As many of the shapes as there is room for, the largest, and their faces."""
    for sides in SIDES:
        faces = [faces_of(solid, sides) for solid in solids]
        if sum(map(len, faces)) <= most:
            return solids, faces
    extents = [np.ptp(np.concatenate([each.corners for each in of]), axis=0).max() for of in faces]
    room, kept = most, []
    for place in sorted(range(len(solids)), key=lambda place: -extents[place]):
        if len(faces[place]) <= room:
            room -= len(faces[place])
            kept.append(place)
    kept.sort()
    return [solids[place] for place in kept], [faces[place] for place in kept]
