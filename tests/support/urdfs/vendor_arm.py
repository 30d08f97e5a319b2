"""A vendor's folder as they come: a package with a URDF and the meshes that it names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

PACKAGE = "acme_description"
INERTIAL = (
    '<inertial><origin xyz="0 0 0.1"/><mass value="2"/>'
    '<inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
)
LIMIT = '<limit lower="-2" upper="2.5" velocity="2" effort="30"/>'


def stl(points: np.ndarray) -> str:
    """The convex hull of points, (m, 3), as an STL file."""
    facets = []
    for corners in np.asarray(points)[ConvexHull(points).simplices]:
        lines = "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in corners.tolist())
        facets.append(f"facet normal 0 0 0\nouter loop\n{lines}endloop\nendfacet\n")
    return f"solid part\n{''.join(facets)}endsolid part\n"


def tube(radius: float, length: float) -> np.ndarray:
    """Points on a tube along z with round ends, (m, 3) [m]: what a capsule fits best."""
    turns = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
    rings = []
    for angle in np.linspace(-np.pi / 2, np.pi / 2, 9):
        side = radius * np.cos(angle)
        height = radius * np.sin(angle) + np.sign(angle) * length / 2
        rings.append(np.stack((side * np.cos(turns), side * np.sin(turns), 0 * turns + height), 1))
    return np.vstack(rings)


def link(name: str, mesh: str = "", inertial: str = INERTIAL) -> str:
    """A link, drawn with a mesh of the package that it also collides with."""
    shape = ""
    if mesh:
        geometry = f'<geometry><mesh filename="package://{PACKAGE}/meshes/{mesh}"/></geometry>'
        shape = f"<visual>{geometry}</visual><collision>{geometry}</collision>"
    return f'<link name="{name}">{inertial}{shape}</link>'


def joint(name: str, parent: str, child: str, inside: str = LIMIT, kind: str = "revolute") -> str:
    """A joint about y, 0.3 m above its parent; `inside` it what is given."""
    axis = "" if kind == "fixed" or "<axis" in inside else '<axis xyz="0 1 0"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 0.3"/>{axis}{inside}</joint>'
    )


LINKS = link("base", "base.stl") + link("upper", "upper.stl") + link("fore") + link("hand")
JOINTS = (
    joint("shoulder", "base", "upper")
    + joint("elbow", "upper", "fore")
    + joint("wrist", "fore", "hand", f'{LIMIT}<axis xyz="1 0 0"/>')
)


def urdf(links: str = LINKS, joints: str = JOINTS, name: str = "acme_arm") -> str:
    """The text of a URDF."""
    return f'<?xml version="1.0"?>\n<robot name="{name}">{links}{joints}</robot>'


def vendor_folder(at: Path, text: str | bytes = "") -> Path:
    """Write the vendor's package below `at`; the path of its URDF."""
    package = at / PACKAGE
    for folder in ("urdf", "meshes"):
        (package / folder).mkdir(parents=True, exist_ok=True)
    corners = np.array(np.meshgrid([-0.1, 0.1], [-0.2, 0.2], [0.0, 0.05])).reshape(3, -1).T
    (package / "meshes" / "base.stl").write_text(stl(corners))
    (package / "meshes" / "upper.stl").write_text(stl(tube(0.04, 0.25)))
    path = package / "urdf" / "arm.urdf"
    path.write_bytes(text if isinstance(text, bytes) else (text or urdf()).encode())
    return path
