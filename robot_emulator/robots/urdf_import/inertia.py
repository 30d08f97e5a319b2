"""The inertia of a link: what can be used of it, and whether a body can have it."""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

import numpy as np

from hoap3.protocol.errors import DescriptionError
from hoap3.robot_emulator.robots.urdf_import.figures import figure
from hoap3.robot_emulator.robots.urdf_import.joints import copy_attributes
from hoap3.robot_emulator.robots.urdf_import.notes import Notes

KEYS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
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
    moments = [figure(inertia, key, where) for key in KEYS]
    if value is None or any(moment is None for moment in moments):
        notes.add("left out", "<inertial> without mass or with half an inertia", name)
        return None
    if value < 0.0 or not math.isfinite(value):
        raise DescriptionError(f"{where}: mass {value:g} kg. Write 0 or more.")
    size = max(abs(moment or 0.0) for moment in moments)
    if value > HEAVY or size > WIDE**2 * value > 0.0:
        text = "masses or inertias that are very large, perhaps not in kg and kg m²"
        notes.add("read", text, f"{name} ({value:g} kg, {size:g} kg m²)")
    if not possible(value, np.array(moments, dtype=np.float64)):
        notes.add("read", "an inertia that no body can have, taken as it is", name)
    new = ET.Element("inertial")
    copy_attributes(inertial.find("origin"), new, ("xyz", "rpy"))
    copy_attributes(mass, new, ("value",))
    copy_attributes(inertia, new, KEYS)
    return new


def possible(mass: float, moments: np.ndarray[tuple[int], np.dtype[np.float64]]) -> bool:
    """Whether a body can have this mass [kg] and inertia, (6,) in the order of `KEYS` [kg m²].

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
