"""What a robot looks like: the shapes of its links, and its meshes by their digests.

A description has primitives. Where the robot's folder is on this machine, its meshes are drawn
instead: those whose content has the digest that `robot.yaml` names, and no others.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints.collision.collision_geometry import rotation
from hoap3.robot_emulator.robots import available
from hoap3.robot_emulator.robots.yaml_file import MeshEntry
from hoap3.tools.picture.meshes import kept_meshes
from hoap3.tools.picture.solids import solids_of

GREY = (0.62, 0.65, 0.70, 1.0)
Shape = dict[str, Any]


@dataclass
class Looks:
    """Shapes of a robot's links.

    Attributes:
        visuals: by link, as the page takes them.
        meshes: as the page takes them, by the digest of their files.
        notes: what is drawn otherwise than `robot.yaml` says, and why.
    """

    visuals: dict[str, list[Shape]]
    meshes: dict[str, bytes] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def looks_of(description: RobotDescription, robot: str | None = None) -> Looks:
    """How to draw a robot.

    Args:
        description: of the robot.
        robot: its name or path on this machine, whose folder has its meshes; None where it is not
            here.
    """
    looks = Looks(primitives(description))
    if robot is not None:
        _add_meshes(looks, description, robot)
    return looks


def shipped_robot(emulator: object) -> str | None:
    """Name of the shipped robot that an emulator's config names, else None; never a path."""
    named = emulator.get("robot") if isinstance(emulator, Mapping) else None
    return named if isinstance(named, str) and named in available() else None


def primitives(description: RobotDescription) -> dict[str, list[Shape]]:
    """The <visual> shapes of each link, its <collision> shapes where it has none."""
    found: dict[str, list[Shape]] = {link: [] for link in description.frames}
    for solid in solids_of(description):
        found[solid.link].append(
            {
                "shape": solid.kind,
                "size": list(solid.size),
                "origin": pose(solid.center, solid.axes),
                "color": list(solid.color or GREY),
            }
        )
    return found


def packed(vertices: FloatArray, triangles: NDArray[np.int64]) -> bytes:
    """A mesh as the page takes it: both counts, vertices, triangles, little endian.

    Args:
        vertices: (n, 3) [m].
        triangles: (m, 3) places of their corners.
    """
    head = struct.pack("<II", len(vertices), len(triangles))
    return head + vertices.astype("<f4").tobytes() + triangles.astype("<u4").tobytes()


def pose(xyz: FloatArray, rotation: FloatArray) -> list[float]:
    """Position and quaternion x y z w of a rotation matrix, (3, 3)."""
    return [*map(float, xyz), *quaternion(rotation)]


def quaternion(rotation: FloatArray) -> list[float]:
    """Unit quaternion x y z w of a rotation matrix, (3, 3), with w ≥ 0."""
    import pinocchio as pin

    found = np.array(pin.Quaternion(np.asarray(rotation, float)).normalized().coeffs())
    return [float(each) for each in (found if found[3] >= 0.0 else -found)]


def _add_meshes(looks: Looks, description: RobotDescription, robot: str) -> None:
    """Draw links with the meshes of the robot's folder that are what its file says."""
    kept = kept_meshes(description, robot)
    looks.notes += kept.notes
    looks.visuals |= {link: [_mesh(each) for each in group] for link, group in kept.entries.items()}
    looks.meshes |= {
        each: packed(kept.vertices[each], kept.triangles[each]) for each in kept.vertices
    }


def _mesh(entry: MeshEntry) -> Shape:
    return {
        "shape": "mesh",
        "size": list(entry.scale),
        "origin": pose(np.array(entry.xyz_m), rotation(*entry.rpy_rad)),
        "color": list(GREY),
        "mesh": f"/mesh/{entry.sha256}",
    }
