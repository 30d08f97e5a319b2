"""The smallest ball around points, in the plane or in space."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from hoap3.protocol.messages import FloatArray

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
