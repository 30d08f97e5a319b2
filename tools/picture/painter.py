"""The order in which faces are painted so that the nearer ones hide the others.

Faces are sorted by a tree that parts space along their own planes: H. Fuchs, Z. M. Kedem and B. F.
Naylor, On visible surface generation by a priori tree structures, SIGGRAPH 1980. What lies across
such a plane is cut, so that the order is right for shapes that reach into each other, too, and
where faces hide each other in a circle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray

TRIED = 6  # faces whose planes are tried where space is parted
CUT = 4  # what a face that is cut counts, against one that makes both sides unequal
ROUNDING = 1e-9  # of the extent of all faces: nearer to a plane is in it


ACROSS = 2  # the side of what is cut by a plane


@dataclass(frozen=True, eq=False)
class Face:
    """A flat, convex face, or a part of one.

    Attributes:
        corners: (k, 3), turning left as seen from outside [m].
        edges: (k,), whether the side from each corner to the next is drawn as an edge.
        index: of the shape that it is a face of.
        convex: whether that shape is, so that those of its faces that the eye sees never hide
            each other.
    """

    corners: FloatArray
    edges: NDArray[np.bool_]
    index: int = 0
    convex: bool = True

    @cached_property
    def normal(self) -> FloatArray:
        """Outwards, twice its area long, (3,) [m²]."""
        spokes = self.corners - self.corners[0]
        a, b = spokes[1:-1].T, spokes[2:].T
        return np.array([a[i - 2] @ b[i - 1] - a[i - 1] @ b[i - 2] for i in range(3)])


def back_to_front(faces: Sequence[Face], toward: FloatArray, most: int) -> list[Face]:
    """Faces in the order in which they are painted, as seen from far away.

    Args:
        faces: which all face the eye.
        toward: (3,), direction to the eye.
        most: so many at the most, unless there are more already. Where cuts would make more,
            nothing is cut, and the order there is by the middles of the faces.
    """
    if not faces:
        return []
    near = ROUNDING * float(np.ptp(np.concatenate([face.corners for face in faces]), axis=0).max())
    spare = max(0, most - len(faces))
    painted: list[Face] = []
    ahead: list[tuple[Sequence[Face], bool]] = [(faces, False)]
    while ahead:
        pieces, done = ahead.pop()
        if done or _of_one(pieces):
            painted += pieces
            continue
        behind, within, before = _parted(pieces, near)
        cuts = len(behind) + len(within) + len(before) - len(pieces)
        if cuts > spare:
            painted += sorted(pieces, key=lambda piece: float(piece.corners.mean(axis=0) @ toward))
            continue
        spare -= cuts
        # what lies behind is taken first
        ahead += [(part, part is within) for part in (before, within, behind) if part]
    return painted


def _of_one(pieces: Sequence[Face]) -> bool:
    """Whether nothing here can hide anything else."""
    first = pieces[0]
    return len(pieces) == 1 or (first.convex and all(p.index == first.index for p in pieces))


def _parted(pieces: Sequence[Face], near: float) -> tuple[list[Face], list[Face], list[Face]]:
    """What is behind, in and before the plane of one of the faces: the one that parts best."""
    corners = np.concatenate([piece.corners for piece in pieces])
    counts = [len(piece.corners) for piece in pieces]
    starts = np.concatenate(([0], np.cumsum(counts)[:-1]))
    normals = np.array([piece.normal for piece in pieces])
    sizes = np.linalg.norm(normals, axis=1)
    largest = np.argsort(-sizes, kind="stable")[:TRIED]
    spread = np.linspace(0, len(pieces) - 1, TRIED).astype(int)
    best, least = None, np.inf
    for place in dict.fromkeys([*largest.tolist(), *spread.tolist()]):
        if sizes[place] == 0.0:
            continue
        away = (corners - corners[starts[place]]) @ (normals[place] / sizes[place])
        side = _sides(away, starts, near)
        side[place] = 0
        cost = CUT * int((side == ACROSS).sum()) + abs(int((side == 1).sum() - (side == -1).sum()))
        if cost < least:
            best, least = (away, side), cost
    if best is None:
        return [], list(pieces), []
    away, side = best
    behind, within, before = (
        [pieces[i] for i in np.flatnonzero(side == which).tolist()] for which in (-1, 0, 1)
    )
    for place in np.flatnonzero(side == ACROSS).tolist():
        here = away[starts[place] : starts[place] + counts[place]]
        behind.append(_half(pieces[place], -here))
        before.append(_half(pieces[place], here))
    return behind, within, before


def _sides(away: FloatArray, starts: NDArray[np.int64], near: float) -> NDArray[np.int64]:
    """Of each face −1 behind, 0 in, 1 before the plane, 2 across it."""
    low = np.minimum.reduceat(away, starts) < -near
    high = np.maximum.reduceat(away, starts) > near
    return np.where(low & high, ACROSS, high.astype(np.int64) - low.astype(np.int64))


def _half(piece: Face, away: FloatArray) -> Face:
    """The part of a face where its corners' distance from a plane, (k,), is not negative."""
    corners, edges = [], []
    for place, (here, edge) in enumerate(zip(piece.corners, piece.edges, strict=True)):
        after = (place + 1) % len(away)
        d, d_after = away[place], away[after]
        if d >= 0.0:
            corners.append(here)
            edges.append(edge and (d > 0.0 or d_after >= 0.0))
        if d * d_after < 0.0:
            corners.append(here + (piece.corners[after] - here) * (d / (d - d_after)))
            edges.append(edge and d_after > 0.0)  # else it is the cut that begins here
    return Face(np.array(corners), np.array(edges), piece.index, piece.convex)
