"""Outlines of soles on the ground: less a margin, as cones of wrenches, and points within them."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.errors import BadProblemError, ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.constraints.support.polygon import half_planes, hull, inset
from hoap3.remote_controller.solvers.contact.wrench_cone import wrench_cone

GRAVITY = 9.81  # m/s²


def on_ground(outline: FloatArray, axes: FloatArray, origin: FloatArray) -> FloatArray:
    """Corners (k, 2) of a sole in the world, from those in its frame (3, 3), (3,) [m]."""
    found: FloatArray = outline @ axes[:2, :2].T + origin[:2]
    return found


def supported(
    wanted: FloatArray, com: FloatArray, height: float, corners: FloatArray
) -> FloatArray:
    """What of a wanted acceleration c̈ of the centre of mass the soles give, x and y (2,).

    Its zero-moment point c − c̈·z/(g + c̈_z) is moved to the nearest point of all soles' outline.

    Args:
        wanted: c̈, (3,) [m/s²].
        com: c, (3,) [m].
        height: z, above the soles [m].
        corners: of the soles in the world, (k, 2) [m].
    """
    lift = GRAVITY + float(wanted[2])
    if not (height > 0.0 and lift > 0.0):
        return wanted[:2]
    point = com[:2] - wanted[:2] * height / lift
    found: FloatArray = (com[:2] - nearest_within(hull(corners), point)) * lift / height
    return found


def nearest_within(corners: FloatArray, point: FloatArray) -> FloatArray:
    """The point of a convex outline, (k, 2) counter-clockwise, that is nearest to a point (2,)."""
    normals, offsets = half_planes(corners)
    if (normals @ point >= offsets).all():
        return point
    along = np.roll(corners, -1, axis=0) - corners
    share = np.einsum("ij,ij->i", point - corners, along) / np.einsum("ij,ij->i", along, along)
    feet = corners + np.clip(share, 0.0, 1.0)[:, None] * along
    found: FloatArray = feet[int(np.argmin(np.linalg.norm(feet - point, axis=1)))]
    return found


def drawn_in(polygon: tuple[tuple[float, float], ...], margin_m: float) -> FloatArray:
    """A sole's outline less a margin, (k, 2) [m].

    Raises:
        ConfigError: nothing is left of it.
    """
    found = inset(hull(np.array(polygon)), margin_m)
    if len(found) < 3:
        problem, remedy = "leaves nothing of a sole", "Make it smaller"
        raise ConfigError("", "contacts.margin_m", margin_m, problem, remedy)
    return found


def cone_of(outline: FloatArray, friction: float) -> FloatArray:
    """Rows of the cone of a sole.

    Raises:
        ConfigError: of a friction that makes none.
    """
    try:
        return wrench_cone(outline, friction)
    except BadProblemError as error:
        raise ConfigError("", "contacts.friction", friction, str(error), "Change it") from error
