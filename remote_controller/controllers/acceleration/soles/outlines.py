"""Outlines of soles on the ground: less a margin, and as cones of wrenches."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.errors import BadProblemError, ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.constraints.support.polygon import hull, inset
from hoap3.remote_controller.solvers.contact.wrench_cone import wrench_cone

GRAVITY = 9.81  # m/s²


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
