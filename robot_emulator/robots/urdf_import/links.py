"""The links of a vendor's URDF, as they can travel: checked inertia, shapes instead of meshes."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.pinocchio_model import roll_pitch_yaw
from hoap3.robot_emulator.robots.urdf_import import mesh_files
from hoap3.robot_emulator.robots.urdf_import.companions import Companion, companions
from hoap3.robot_emulator.robots.urdf_import.figures import figure, triple, written
from hoap3.robot_emulator.robots.urdf_import.fitting import Shape
from hoap3.robot_emulator.robots.urdf_import.joints import copy_attributes
from hoap3.robot_emulator.robots.urdf_import.mesh_files import MeshError, content, shape_of
from hoap3.robot_emulator.robots.urdf_import.notes import Notes
from hoap3.robot_emulator.robots.urdf_import.packages import SearchPath, UnresolvedError

PRIMITIVES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}


@dataclass(frozen=True, eq=False)
class Visual:
    """A mesh that a link is drawn with; it stays in the robot's folder.

    Attributes:
        link: that it belongs to.
        path: of the file, here.
        sha256: of its content.
        scale, xyz, rpy: (3,) of the mesh, and where it is in the link [m, rad].
        companions: files beside it that it names.
    """

    link: str
    path: Path
    sha256: str
    scale: FloatArray
    xyz: FloatArray
    rpy: FloatArray
    companions: tuple[Companion, ...] = ()


@dataclass
class ReadLinks:
    """What became of the links.

    Attributes:
        made: the links as they can travel.
        massless: names of those without an inertia.
        visuals: the meshes that they are drawn with.
    """

    made: list[ET.Element] = field(default_factory=list)
    massless: list[str] = field(default_factory=list)
    visuals: list[Visual] = field(default_factory=list)


def read_links(robot: ET.Element, search: SearchPath, notes: Notes, *, strict: bool) -> ReadLinks:
    """The links as they can travel, in the order of the file.

    Args:
        robot: of the vendor's URDF.
        search: where meshes are.
        notes: takes what was found.
        strict: a mesh that cannot be found or read is an error.

    Raises:
        DescriptionError: a link cannot be what the file says; names it.
    """
    found = ReadLinks()
    for element in robot.findall("link"):
        name = element.get("name", "")
        where = f"URDF link {name!r:.80}"
        new = ET.Element("link", name=name)
        inertial = read_inertial(element, where, notes)
        if inertial is None:
            found.massless.append(name)
        else:
            new.append(inertial)
        reader = _Geometry(name, where, search, notes, strict)
        for visual in element.findall("visual"):
            new.extend(reader.visual(visual, found.visuals))
        for collision in element.findall("collision"):
            new.extend(reader.collision(collision))
        found.made.append(new)
    return found


@dataclass(frozen=True)
class _Geometry:
    """Reads the shapes of one link."""

    link: str
    where: str
    search: SearchPath
    notes: Notes
    strict: bool

    def collision(self, element: ET.Element) -> list[ET.Element]:
        """Primitives as they are; instead of a mesh what contains it."""
        shape = _shape(element)
        if shape is None or shape.tag != "mesh":
            return self._primitive(element, shape)
        scale = triple(shape, "scale", self.where, 1.0)
        try:
            fitted = shape_of(self.search.find(shape.get("filename", "")), scale)
        except (MeshError, UnresolvedError) as error:
            self._missing("collision", shape, error)
            return []
        self.notes.lengths(map(str, fitted.size), f"link {self.link}")
        text = "collision meshes became the tightest box, capsule or sphere around them"
        self.notes.add("read", text, self.link)
        return self._placed(element, fitted)

    def visual(self, element: ET.Element, meshes: list[Visual]) -> list[ET.Element]:
        """Primitives as they are; meshes stay here."""
        shape = _shape(element)
        if shape is None or shape.tag != "mesh":
            return self._primitive(element, shape)
        origin, scale = element.find("origin"), triple(shape, "scale", self.where, 1.0)
        xyz, rpy = (triple(origin, key, self.where, 0.0) for key in ("xyz", "rpy"))
        try:
            path = self.search.find(shape.get("filename", ""))
            data = content(path)
            unit, up = mesh_files.collada_asset(path, data)
            if up != "Z_UP":
                text = f"<up_axis> {up} of meshes, as RViz and Pinocchio leave it out"
                self.notes.add("left out", text, path.name)
            own = self._companions(path, data, meshes)
            digest = hashlib.sha256(data).hexdigest()
            meshes.append(Visual(self.link, path, digest, unit * scale, xyz, rpy, own))
        except (MeshError, UnresolvedError) as error:
            self._missing("visual", shape, error)
        return []

    def _companions(self, path: Path, data: bytes, meshes: list[Visual]) -> tuple[Companion, ...]:
        """What a mesh names that can be kept beside it, and beside those of the other meshes."""
        taken = {each.name: each.sha256 for mesh in meshes for each in mesh.companions}
        found = []
        for each in companions(path, data):
            if not isinstance(each, Companion):
                name, why = each
            elif taken.setdefault(each.name, each.sha256) == each.sha256:
                found.append(each)
                continue
            else:
                name, why = each.name, "another one is called so"
            self.notes.add("left out", f"files that meshes name, {why}", name[-120:])
        return tuple(found)

    def _missing(self, what: str, mesh: ET.Element, error: DescriptionError) -> None:
        name = mesh.get("filename", "")
        if self.strict:
            raise DescriptionError(f"{self.where}: {what} mesh {name!r:.120}: {error}.") from error
        self.notes.add("left out", f"{what} meshes, {error}", name[-120:])

    def _primitive(self, element: ET.Element, shape: ET.Element | None) -> list[ET.Element]:
        if shape is None:
            self.notes.add("left out", f"<{element.tag}> without a shape", self.link)
            return []
        if shape.tag == "capsule":
            radius, length = (figure(shape, key, self.where) or 0.0 for key in ("radius", "length"))
            if radius > 0.0 and length >= 0.0:
                capsule = Shape("capsule", (radius, length), np.zeros(3), np.eye(3))
                return self._placed(element, capsule)
        elif shape.tag in PRIMITIVES:
            sizes = [shape.get(key, "") for key in PRIMITIVES[shape.tag]]
            if all(map(_positive, " ".join(sizes).split())):
                new = ET.Element(element.tag)
                copy_attributes(element.find("origin"), new, ("xyz", "rpy"))
                geometry = ET.SubElement(new, "geometry")
                copy_attributes(shape, geometry, PRIMITIVES[shape.tag])
                return [new]
        else:
            text = f"<{element.tag}> of an unknown shape <{shape.tag[:40]}>"
            self.notes.add("left out", text, self.link)
            return []
        text = f"<{element.tag}> {shape.tag} without an extent"
        self.notes.add("left out", text, self.link)
        return []

    def _placed(self, element: ET.Element, shape: Shape) -> list[ET.Element]:
        """A shape as primitives; a capsule is a cylinder and the spheres at its ends."""
        from scipy.spatial.transform import Rotation

        origin = element.find("origin")
        xyz, rpy = (triple(origin, key, self.where, 0.0) for key in ("xyz", "rpy"))
        outer = Rotation.from_euler("xyz", rpy)
        axes = (outer * Rotation.from_matrix(shape.axes)).as_matrix()
        center = xyz + outer.apply(shape.center)
        turn = written(roll_pitch_yaw(axes))
        if shape.kind == "box":
            return [_element(element.tag, center, turn, "box", size=written(shape.size))]
        radius, length = (*shape.size, 0.0)[:2]
        end = axes[:, 2] * length / 2
        round_ends = [
            _element(element.tag, place, None, "sphere", radius=written((radius,)))
            for place in ((center + end, center - end) if length else (center,))
        ]
        if not length:
            return round_ends
        sizes = {"radius": written((radius,)), "length": written((length,))}
        return [_element(element.tag, center, turn, "cylinder", **sizes), *round_ends]


def _shape(element: ET.Element) -> ET.Element | None:
    return next(iter(element.iterfind("geometry/*")), None)


def _positive(text: str) -> bool:
    try:
        return float(text) > 0.0
    except ValueError:
        return False


def _element(
    tag: str, center: FloatArray, turn: str | None, shape: str, **sizes: str
) -> ET.Element:
    new = ET.Element(tag)
    place = {"xyz": written(center)} | ({} if turn is None else {"rpy": turn})
    ET.SubElement(new, "origin", place)
    ET.SubElement(ET.SubElement(new, "geometry"), shape, sizes)
    return new


INERTIA_KEYS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
HEAVY, WIDE = 500.0, 10.0  # kg, and m of a radius of gyration: more is probably another unit
ROUNDED = 1e-3  # of the greatest principal moment: what figures of three digits may miss


def read_inertial(link: ET.Element, where: str, notes: Notes) -> ET.Element | None:
    """The <inertial> of a link as it can travel, or None where it has none that can be used.

    Raises:
        DescriptionError: a figure is none, or a mass is negative.
    """
    inertial = link.find("inertial")
    if inertial is None:
        return None
    name = link.get("name", "")
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    value = figure(mass, "value", where)
    moments = [figure(inertia, key, where) for key in INERTIA_KEYS]
    if value is None or any(moment is None for moment in moments):
        notes.add("left out", "<inertial> without mass or with half an inertia", name)
        return None
    if value < 0.0 or not math.isfinite(value):
        raise DescriptionError(f"{where}: mass {value:g} kg. Write 0 or more.")
    size = max(abs(moment or 0.0) for moment in moments)
    if value > HEAVY or size > WIDE**2 * value > 0.0:
        text = "masses or inertias that are very large, perhaps not in kg and kg m²"
        notes.add("read", text, f"{name} ({value:g} kg, {size:g} kg m²)")
    if not is_possible_inertia(value, np.array(moments, dtype=np.float64)):
        notes.add("read", "an inertia that no body can have, taken as it is", name)
    new = ET.Element("inertial")
    copy_attributes(inertial.find("origin"), new, ("xyz", "rpy"))
    copy_attributes(mass, new, ("value",))
    copy_attributes(inertia, new, INERTIA_KEYS)
    return new


def is_possible_inertia(mass: float, moments: np.ndarray[tuple[int], np.dtype[np.float64]]) -> bool:
    """Whether a body can have a mass [kg] and inertia, (6,) in the order of the keys [kg m²].

    About the centre of mass the principal moments are sums of two of three figures ∫x² dm that are
    not negative: none is negative, and none is more than the sum of the others. Without a mass
    there is no inertia.
    """
    if not np.isfinite(moments).all():
        return False
    xx, xy, xz, yy, yz, zz = moments
    principal = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    spare = ROUNDED * float(np.abs(principal).max())
    if mass == 0.0:
        return not moments.any()
    return bool(principal[0] >= -spare and principal[2] <= principal[0] + principal[1] + spare)
