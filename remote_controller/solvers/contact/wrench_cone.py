"""The wrenches that a flat sole can take from the ground, as linear inequalities.

Forces act at the corners of the sole, each inside a pyramid of friction. The wrenches that they
sum up to are a convex cone (Caron, Pham and Nakamura, ICRA 2015, who have the closed form of a
rectangle). Scaled to a normal force of 1 its edges are points in five dimensions, and the facets
of their convex hull are the inequalities: of any convex outline, and without a variable for each
edge.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError

Array = NDArray[np.float64]

SAME = 9  # decimals: facets that are as near as that to each other are one


def cone_edges(corners: ArrayLike, friction: float) -> Array:
    """Wrenches of unit normal force along the edges of the pyramids at all corners.

    The pyramid |f_x| ≤ μ/√2·f_z, |f_y| ≤ μ/√2·f_z lies within the cone of friction μ.

    Args:
        corners: of the sole in its frame, which has z up and the sole at z = 0, (k, 2) [m].
        friction: μ.

    Returns:
        (4k, 6): f [N] over the moment about the frame's origin [N m], both in the frame's axes.
    """
    slope = friction / math.sqrt(2.0)
    edges = []
    for x, y in np.asarray(corners, dtype=np.float64):
        for sx in (slope, -slope):
            for sy in (slope, -slope):
                force = np.array([sx, sy, 1.0])
                edges.append(np.concatenate([force, np.cross([x, y, 0.0], force)]))
    return np.array(edges)


def wrench_cone(corners: ArrayLike, friction: float) -> Array:
    """Rows A of A·w ≤ 0, which hold exactly where w is a sum of forces inside the pyramids.

    Args:
        corners, friction: as of `cone_edges`; the corners go round a convex outline.

    Returns:
        (r, 6), each row of length 1 where moments are counted in units of the sole's size; 16 rows
        for a rectangle.

    Raises:
        BadProblemError: fewer than 3 corners, in one line, or friction that is not positive.
    """
    from scipy.spatial import ConvexHull, QhullError

    outline = np.asarray(corners, dtype=np.float64)
    if outline.ndim != 2 or outline.shape[0] < 3 or outline.shape[1] != 2:
        raise BadProblemError(f"a sole needs 3 corners (x, y) or more (found {outline.shape}).")
    if not 0.0 < friction < math.inf:
        raise BadProblemError(f"friction must be positive (found {friction}).")
    units = wrench_units(outline)
    edges = cone_edges(outline, friction) / units
    others = [0, 1, 3, 4, 5]  # all but the normal force, which is 1
    try:
        facets = ConvexHull(edges[:, others]).equations
    except (QhullError, ValueError) as error:
        raise BadProblemError("the corners of a sole must not lie in one line.") from error
    rows = np.zeros((len(facets), 6))
    rows[:, others], rows[:, 2] = facets[:, :5], facets[:, 5]
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    kept = np.unique(np.round(rows, SAME), axis=0, return_index=True)[1]
    found: Array = rows[np.sort(kept)] / units
    return found


def wrench_units(corners: ArrayLike) -> Array:
    """1 N for forces, and for moments that at the farthest corner of the sole, (6,)."""
    size = float(np.linalg.norm(np.asarray(corners, dtype=np.float64), axis=1).max())
    return np.array([1.0, 1.0, 1.0, size, size, size])
