"""Inertias that MuJoCo does not take as a URDF has them, and what becomes of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from hoap3.protocol.messages import FloatArray

LEAST = 2e-15
"""kg and kg m² of what moves without mass or inertia: the least that MuJoCo takes."""

ROUNDING = 1e-9  # of the greatest principal moment
THIN = 1e-6  # of it: what a moment that is not positive becomes
POINT = 1e-9  # m²: inertia by mass of what has none
_SIX = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)  # of a symmetric matrix, as MuJoCo orders them


def repair(spec: Any) -> dict[str, str]:
    """Make every inertia of a spec one that MuJoCo takes.

    A principal moment that is not positive becomes a millionth of the greatest; moments of which
    one exceeds the sum of the others become their mean, as MuJoCo's `balanceinertia` has it; a body
    with a joint and without mass, also of what is fixed to it, gets the least.

    Returns:
        By body, what is not as the URDF says.
    """
    spec.compiler.balanceinertia = True
    changed = {}
    for body in spec.bodies[1:]:
        why = _repaired(body) if body.explicitinertial else ""
        if len(body.joints) and not _weighs(body):
            body.mass, body.inertia, body.explicitinertial = LEAST, [LEAST] * 3, True
            why = "moves without mass"
        if why:
            changed[body.name] = why
    return changed


def _repaired(body: Any) -> str:
    """Repair one body, and say why; "" where nothing was to be done."""
    full = np.array(body.fullinertia)
    tensor: FloatArray = np.diag(np.array(body.inertia))
    if np.isfinite(full).all():  # else MuJoCo has principal moments only
        tensor[_SIX] = tensor[_SIX[::-1]] = full
    moments, axes = np.linalg.eigh(tensor)
    if not body.mass > 0.0:
        body.fullinertia = np.full(6, np.nan)
        body.mass, body.inertia, body.explicitinertial = 0.0, [0.0] * 3, False
        return "has inertia without mass" if moments[-1] > 0.0 else ""
    if moments[-1] < LEAST:
        body.fullinertia, body.inertia = np.full(6, np.nan), [POINT * body.mass] * 3
        return "has mass without inertia"
    if moments[0] < ROUNDING * moments[-1]:
        tensor = axes @ np.diag(np.maximum(moments, THIN * moments[-1])) @ axes.T
        body.fullinertia = tensor[_SIX]
        return "has a principal moment of inertia that is not positive"
    if moments[0] + moments[1] < moments[2] * (1.0 - ROUNDING):
        return "has a principal moment of inertia above the sum of the others"
    return ""


def _weighs(body: Any) -> bool:
    """Whether a body has mass, or what is fixed to it."""
    return body.mass > 0.0 or any(_weighs(each) for each in body.bodies if not len(each.joints))
