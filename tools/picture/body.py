"""A robot that can be put into postures, as faces in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.tools.picture.faces import faces_of
from hoap3.tools.picture.painter import Face
from hoap3.tools.picture.solids import Solid, solids_of

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
        self._kinematics = Kinematics(description)
        names = description.frames
        self._ids = np.array([self._kinematics.frame_id(name) for name in names])
        self._frames = {name: place for place, name in enumerate(names)}
        self._base = self._frames[description.base_frame]
        shapes = solids_of(description) if solids is None else solids
        self.solids, faces = _within(shapes, most)
        self.left_out = len(shapes) - len(self.solids)
        self.bones = [
            (self._frames[joint.parent], self._frames[joint.child])
            for joint in description.structure.joints
        ]
        flat = [face for group in faces for face in group]
        self._edges = [face.edges for face in flat]
        self._convex = [solid.kind != "mesh" for solid in self.solids]
        self._groups = [place for place, group in enumerate(faces) for _ in group]
        corners = [len(face.corners) for face in flat]
        self._corners = np.concatenate([np.empty((0, 3)), *(face.corners for face in flat)])
        links = np.array([self._frames[solid.link] for solid in self.solids], np.intp)
        self._moves_with = np.repeat(links[np.array(self._groups, np.intp)], corners)
        self._starts = np.cumsum([0, *corners]).tolist()

    def place(self, q: FloatArray, base: FloatArray | None = None) -> Placement:
        """Where all frames are.

        Args:
            q: (n,) joint positions [rad or m].
            base: of a free base x y z [m] and a quaternion x y z w, as `State.base` begins, or
                None or nothing.
        """
        self._kinematics.update(np.asarray(q, np.float64))
        origins, rotations, *_ = self._kinematics.frames()
        places, turns = origins[self._ids], rotations[self._ids]
        if base is not None and len(base):
            turn, origin = from_quaternion(base[3:7]), np.asarray(base[:3])
        else:
            turn = turns[self._base].T
            origin = -turn @ places[self._base]
        return Placement(places @ turn.T + origin, turn @ turns, self._frames)

    def points(self, placement: Placement) -> FloatArray:
        """Every corner of a face, and every origin of a frame, in the world, (m, 3) [m]."""
        return np.concatenate((placement.origins, self._placed(placement)))

    def faces(self, placement: Placement) -> list[Face]:
        """Every face in the world; its `index` says which of `solids` it belongs to."""
        placed = self._placed(placement)
        pieces = zip(self._starts[:-1], self._starts[1:], self._edges, self._groups, strict=True)
        return [
            Face(placed[start:end], edges, group, self._convex[group])
            for start, end, edges, group in pieces
        ]

    def _placed(self, placement: Placement) -> FloatArray:
        turns = placement.rotations[self._moves_with]
        placed = np.einsum("nij,nj->ni", turns, self._corners)
        return np.asarray(placed + placement.origins[self._moves_with])


def from_quaternion(quaternion: FloatArray) -> FloatArray:
    """Rotation of a quaternion x y z w of any length, (3, 3); of zero, none."""
    length = float(np.linalg.norm(quaternion))
    x, y, z, w = np.asarray(quaternion) / length if length > 0.0 else (0.0, 0.0, 0.0, 1.0)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + 2.0 * (w * skew + skew @ skew))


def _within(solids: list[Solid], most: int) -> tuple[list[Solid], list[list[Face]]]:
    """As many of the shapes as there is room for, the largest, and their faces."""
    for sides in SIDES:
        faces = [faces_of(solid, sides) for solid in solids]
        if sum(map(len, faces)) <= most:
            return solids, faces
    order = sorted(range(len(solids)), key=lambda place: -solids[place].reach)
    room, kept = most, []
    for place in order:
        if len(faces[place]) <= room:
            room -= len(faces[place])
            kept.append(place)
    kept.sort()
    return [solids[place] for place in kept], [faces[place] for place in kept]
