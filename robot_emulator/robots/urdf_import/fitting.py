"""The tightest box, capsule or sphere around the vertices of a mesh.

A shape that contains the vertices contains the mesh, because all three are convex. Which of them
has the least volume is taken. Boxes are tried along the axes of the mesh, along its principal axes,
and flat on the largest faces of its convex hull, turned there to each edge of the hull's outline
(the smallest box has a face on the hull: O'Rourke, Int. J. Computer and Information Sciences 14(3),
1985, for two of its faces on edges). A capsule's axis is one of the same axes, its radius that of
the smallest circle around the vertices as seen along it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from hoap3.protocol.messages import FloatArray

FACES = 12  # of the hull that a box is laid on, the largest ones
LEAST_M = 1e-4  # of an extent or a radius: nothing is thinner
SPARE_M = 1e-6  # that a shape is larger, so that its rounded figures contain what it was made for


@dataclass(frozen=True, eq=False)
class Shape:
    """A shape and where it is.

    Attributes:
        kind: what it is.
        size: box: its three extents; capsule: radius, and length between the centres of its ends;
            sphere: radius [m].
        center: (3,) [m].
        axes: (3, 3) its axes as columns; a capsule lies along the third.
    """

    kind: Literal["box", "capsule", "sphere"]
    size: tuple[float, ...]
    center: FloatArray
    axes: FloatArray

    @property
    def volume(self) -> float:
        """[m³]."""
        if self.kind == "box":
            return float(np.prod(self.size))
        radius, length = (*self.size, 0.0)[:2]
        return float(np.pi * radius**2 * (length + 4.0 / 3.0 * radius))


def tightest(vertices: FloatArray) -> Shape:
    """The shape of the least volume that contains the vertices, (m, 3) [m], m > 0."""
    points, normals = _hull(vertices)
    principal = _principal_axes(points)
    boxes = [_box(points, np.eye(3)), _box(points, principal)]
    boxes += [_box(points, _turned(points, normal)) for normal in normals]
    box = min(boxes, key=lambda shape: shape.volume)
    directions = np.hstack((box.axes, principal)).T
    capsules = [_capsule(points, direction) for direction in directions]
    center, radius = enclosing_ball(points)
    sphere = Shape("sphere", (max(radius, LEAST_M) + SPARE_M,), center, np.eye(3))
    return min((box, *capsules, sphere), key=lambda shape: shape.volume)


def _hull(vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Corners of the convex hull, and the normals of its largest faces; of flat ones, no normal."""
    from scipy.spatial import ConvexHull, QhullError

    points = np.unique(vertices, axis=0)
    if len(points) < 4:
        return points, np.empty((0, 3))
    try:
        hull = ConvexHull(points)
    except QhullError:  # all in a plane or in a line
        return points, np.empty((0, 3))
    a, b, c = points[hull.simplices].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    merged, where = np.unique(np.round(hull.equations[:, :3], 6), axis=0, return_inverse=True)
    largest = np.argsort(np.bincount(where.ravel(), areas))[::-1][:FACES]
    return points[hull.vertices], merged[largest]


def _principal_axes(points: FloatArray) -> FloatArray:
    """Of the points' covariance, as columns of a rotation."""
    spread = points - points.mean(axis=0)
    axes = np.linalg.eigh(spread.T @ spread)[1]
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return axes


def _basis(normal: FloatArray) -> FloatArray:
    """A rotation whose third column is along the normal."""
    z = normal / np.linalg.norm(normal)
    x = np.cross(np.eye(3)[int(np.abs(z).argmin())], z)
    x /= np.linalg.norm(x)
    return np.stack((x, np.cross(z, x), z), axis=1)


def _turned(points: FloatArray, normal: FloatArray) -> FloatArray:
    """Axes of a box that lies on a face: the least rectangle around the outline seen along it."""
    from scipy.spatial import ConvexHull, QhullError

    basis = _basis(normal)
    flat = points @ basis[:, :2]
    try:
        outline = flat[ConvexHull(flat).vertices]
    except QhullError:
        return basis
    edges = np.roll(outline, -1, axis=0) - outline
    edges = edges[np.linalg.norm(edges, axis=1) > 0.0]
    along = edges / np.linalg.norm(edges, axis=1)[:, None]
    across = np.stack((-along[:, 1], along[:, 0]), axis=1)
    areas = np.ptp(outline @ along.T, axis=0) * np.ptp(outline @ across.T, axis=0)
    best = int(areas.argmin())
    x, y = basis[:, :2] @ along[best], basis[:, :2] @ across[best]
    return np.stack((x, y, basis[:, 2]), axis=1)


def _box(points: FloatArray, axes: FloatArray) -> Shape:
    inside = points @ axes
    low, high = inside.min(axis=0), inside.max(axis=0)
    x, y, z = (np.maximum(high - low, LEAST_M) + 2 * SPARE_M).tolist()
    return Shape("box", (x, y, z), axes @ ((low + high) / 2), axes)


def _capsule(points: FloatArray, direction: FloatArray) -> Shape:
    """The shortest capsule about the smallest circle around the points as seen along an axis.

    A point at distance d from the axis is inside where the segment comes as near along the axis
    as √(r² − d²).
    """
    axes = _basis(direction)
    inside = points @ axes
    middle, radius = enclosing_ball(inside[:, :2])
    radius = max(radius, LEAST_M)
    reach = np.sqrt(np.maximum(radius**2 - ((inside[:, :2] - middle) ** 2).sum(axis=1), 0.0))
    first, last = (inside[:, 2] + reach).min(), (inside[:, 2] - reach).max()
    if first > last:  # no segment is needed, a sphere anywhere between would do
        first = last = (first + last) / 2
    center = axes @ np.array([*middle, (first + last) / 2])
    return Shape("capsule", (radius + SPARE_M, float(last - first) + 2 * SPARE_M), center, axes)


ROUNDING = 1e-12  # of a squared radius, relative to the points' extent
MOST_EXCHANGES = 1000


def enclosing_ball(points: FloatArray) -> tuple[FloatArray, float]:
    """Centre (d,) and radius of the smallest ball that contains the points, (m, d).

    The ball is that of at most d + 1 of the points. The farthest point outside joins them, and the
    smallest ball of these few is found by trying their subsets: each exchange makes the ball
    larger, so that no set comes twice (an LP-type problem: Matousek, Sharir, Welzl, Algorithmica
    16, 1996). The radius is at last the greatest distance, so that rounding leaves no point out.
    """
    extent = float(np.ptp(points, axis=0).max(initial=0.0))
    support = points[:1]
    center, radius = points[0].copy(), 0.0
    for _ in range(MOST_EXCHANGES):
        squared = ((points - center) ** 2).sum(axis=1)
        farthest = int(squared.argmax())
        if squared[farthest] <= radius**2 + ROUNDING * extent**2:
            break
        support, center, radius = _ball_of_few(np.vstack((support, points[farthest])))
    return center, float(np.sqrt(((points - center) ** 2).sum(axis=1).max()))


def _ball_of_few(points: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Those of at most d + 2 points that define the smallest ball around all, and that ball."""
    best: tuple[FloatArray, FloatArray, float] | None = None
    extent = float(np.ptp(points, axis=0).max())
    for size in range(1, min(len(points), points.shape[1] + 1) + 1):
        for chosen in combinations(range(len(points)), size):
            few = points[list(chosen)]
            center, radius = _circumscribed(few)
            outside = ((points - center) ** 2).sum(axis=1).max() - radius**2
            if outside <= ROUNDING * extent**2 and (best is None or radius < best[2]):
                best = few, center, radius
    if best is None:  # points so close to degenerate that rounding hides the answer
        center = (points.min(axis=0) + points.max(axis=0)) / 2
        return points, center, float(np.sqrt(((points - center) ** 2).sum(axis=1).max()))
    return best


def _circumscribed(points: FloatArray) -> tuple[FloatArray, float]:
    """The smallest ball that has all of the points on its surface."""
    first = points[0]
    edges = points[1:] - first
    if not len(edges):
        return first.copy(), 0.0
    offset, *_ = np.linalg.lstsq(2.0 * edges, (edges**2).sum(axis=1), rcond=None)
    return first + offset, float(np.linalg.norm(offset))
