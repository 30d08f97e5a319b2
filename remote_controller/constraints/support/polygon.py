"""Convex outlines on the ground."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray


def hull(points: FloatArray) -> FloatArray:
    """Convex hull of points (k, 2), counter-clockwise, without corners on straight edges.

    Monotone chain on points rounded to 1 nm: its order must not hang on the last bits of
    corners that stand one above the other.
    """
    points = np.round(points, 9)
    slack = 1e-14 * float(np.ptp(points, axis=0).max()) ** 2
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]

    def chain(candidates: FloatArray) -> list[FloatArray]:
        kept: list[FloatArray] = []
        for point in candidates:
            while len(kept) > 1 and _turn(kept[-2], kept[-1], point) <= slack:
                kept.pop()
            kept.append(point)
        return kept[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))


def half_planes(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Edges of a counter-clockwise outline (k, 2) as n·p ≥ offset, for p inside.

    Returns:
        Unit normals, (k, 2), pointing inwards, and offsets, (k,).
    """
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.stack((-edges[:, 1], edges[:, 0]), axis=1)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return normals, np.einsum("ij,ij->i", normals, corners)


def inset(corners: FloatArray, margin: float) -> FloatArray:
    """The outline whose edges lie further in by `margin`, (k, 2); no corners if nothing is left."""
    rest = corners
    for normal, offset in zip(*half_planes(corners), strict=True):
        if not len(rest):
            return rest
        inside = rest @ normal - (offset + margin)
        kept = []
        for here, there, m_here, m_there in zip(
            rest, np.roll(rest, -1, axis=0), inside, np.roll(inside, -1), strict=True
        ):
            if m_here >= 0.0:
                kept.append(here)
            if (m_here >= 0.0) != (m_there >= 0.0):
                kept.append(here + (there - here) * (m_here / (m_here - m_there)))
        rest = np.array(kept).reshape(-1, 2)
    return rest


def _turn(first: FloatArray, second: FloatArray, third: FloatArray) -> float:
    a, b = second - first, third - first
    return float(a[0] * b[1] - a[1] * b[0])
