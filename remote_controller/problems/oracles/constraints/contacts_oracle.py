"""Where pairs of rounded boxes are nearest to each other, or nearly so.

All of it comes down to segments against boxes: the core of a sphere or capsule, or of two boxes
the edges of each. A nearest point of two boxes can be chosen so that it lies on an edge of one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.oracles.constraints import segments_oracle as segments

Array = NDArray[np.float64]
Places = NDArray[np.int64]

ALONE = 1e-12  # m: beyond the nearest point, where it alone has a row
STEEP = 5.0  # spreads along a segment that a further point is from the nearest one, at least
TIED = 1e-10  # m: points that are nearer than the others by less may all be the nearest one
SAME = 8  # decimals in which points and normals are the same
SIDES = np.array([[x, y, z] for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)])
CORE = np.array([[0, 4]])  # corners that a core joins: those of a box with an extent along z only
EDGES = np.array([[i, i | bit] for bit in (1, 2, 4) for i in range(8) if not i & bit])


@dataclass(frozen=True)
class Segments:
    """Segments of some pairs, in the axes of the box that they are held against.

    Attributes:
        pair: of each, (K,); `box` the number of the body that is the box, (K,).
        side: 0 where the segment belongs to the first of the pair, 1 to the second, (K,).
        a, d, half: (K, 3) [m], a + s·d, and the box.
        s, distance, normal: where it is nearest, (K,), how far, (K,), and the way there, (K, 3).
    """

    pair: Places
    box: Places
    side: Places
    a: Array
    d: Array
    half: Array
    s: Array
    distance: Array
    normal: Array


@dataclass(frozen=True)
class Points:
    """Points of pairs that may have rows.

    Attributes:
        pair: of each, (k,).
        place: on the segment, (k, 3) [m], in the root's axes.
        normal: from the second of the pair to the first, (k, 3), likewise.
        distance: of the cores there, (k,) [m].
        asked: whether such a point certainly has a row, (k,).
    """

    pair: Places
    place: Array
    normal: Array
    distance: Array
    asked: NDArray[np.bool_]


@dataclass(frozen=True)
class Scene:
    """Bodies where they are, and pairs of them.

    Attributes:
        middles, turns, half: (B, 3) [m], (B, 3, 3), (B, 3) [m] of the boxes, in the root's axes.
        which: (P, 2) the two bodies.
        edged: (P,) whether both have edges; else the first has none.
    """

    middles: Array
    turns: Array
    half: Array
    which: Places
    edged: NDArray[np.bool_]

    def at_least(self, pairs: Places) -> Array:
        """Lower bounds of the distances of some pairs' boxes, (p,): along the axes of each."""
        found = np.zeros(len(pairs))
        for side in (0, 1):
            first, second = self.which[pairs, side], self.which[pairs, 1 - side]
            back = self.turns[second].swapaxes(1, 2)
            apart = (back @ (self.middles[first] - self.middles[second])[..., None])[..., 0]
            wide = (np.abs(back @ self.turns[first]) @ self.half[first][..., None])[..., 0]
            away = np.maximum(np.abs(apart) - wide - self.half[second], 0.0)
            found = np.maximum(found, np.linalg.norm(away, axis=1))
        return found

    def segments(self, pairs: Places, spread: float) -> Segments:
        """Those of some pairs, (p,), that may be as near as they are and a spread."""
        cores, boxes = pairs[~self.edged[pairs]], pairs[self.edged[pairs]]
        sets = ((cores, 0, CORE), (boxes, 0, EDGES), (boxes, 1, EDGES))
        parts = [self._against(*one, spread) for one in sets if len(one[0])]
        parts = parts or [self._against(*sets[0], spread)]
        pair, box, side = (np.concatenate([part[i] for part in parts]) for i in range(3))
        a, d = (np.concatenate([part[3][i] for part in parts]) for i in range(2))
        half = self.half[box]
        s = segments.nearest(a, d, half)
        return Segments(pair, box, side, a, d, half, s, *segments.distance(a, d, half, s))

    def _against(
        self, pairs: Places, side: int, edges: Places, spread: float
    ) -> tuple[Places, Places, Places, tuple[Array, Array]]:
        """Pair, box and side of each segment, and its a and d."""
        first, second = self.which[pairs, side], self.which[pairs, 1 - side]
        back = self.turns[second].swapaxes(1, 2)
        apart = (back @ (self.middles[first] - self.middles[second])[..., None])[..., 0]
        corners = SIDES * self.half[first][:, None]
        corners = corners @ (back @ self.turns[first]).swapaxes(1, 2) + apart[:, None]
        near = _near_edges(segments.beyond(corners, self.half[second][:, None]), edges, spread)
        a, b = corners[:, edges[:, 0]][near], corners[:, edges[:, 1]][near]
        here = near.nonzero()[0]
        return pairs[here], second[here], np.full(len(here), side), (a, b - a)

    def points(self, found: Segments, reach: Array, spread: float, contact: Places) -> Points:
        """The nearest points of pairs, and the ends of what is nearly as near of those in contact.

        Args:
            found: segments of pairs.
            reach: how near points of each pair come, (P,) [m].
            spread: [m].
            contact: (P,) whether a pair is in contact.
        """
        near = found.distance <= reach[found.pair]
        pair, s = found.pair[near], found.s[near]
        a, d, half = found.a[near], found.d[near], found.half[near]
        places, rows = [s], [np.arange(len(s))]
        with np.errstate(divide="ignore"):
            away = STEEP * spread / np.maximum(np.linalg.norm(d, axis=1), ALONE)
        for end in (0.0, 1.0):
            further = np.clip(s + (2.0 * end - 1.0) * away, 0.0, 1.0)
            flat, _ = segments.distance(a, d, half, further)
            has = contact[pair] & (further != s) & (flat <= reach[pair])
            if not has.any():
                continue
            ends = np.full(int(has.sum()), end)
            given = a[has], d[has], half[has], s[has], ends, reach[pair[has]]
            places.append(segments.furthest(*given))
            rows.append(np.flatnonzero(has))
        return self._laid_out(
            found, np.flatnonzero(near)[np.concatenate(rows)], np.concatenate(places)
        )

    def _laid_out(self, found: Segments, rows: Places, s: Array) -> Points:
        """Points of segments in the root's axes, each once."""
        a, d, half = found.a[rows], found.d[rows], found.half[rows]
        box, pair = found.box[rows], found.pair[rows]
        distance, normal = segments.distance(a, d, half, s)
        place = self.middles[box] + (self.turns[box] @ (a + s[:, None] * d)[..., None])[..., 0]
        outwards = (self.turns[box] @ normal[..., None])[..., 0]
        sense = 1.0 - 2.0 * found.side[rows]
        between = place - 0.5 * distance[:, None] * outwards
        normal = sense[:, None] * outwards
        key = np.column_stack([pair, between, normal]).round(SAME) + 0.0
        once = np.sort(np.unique(key, axis=0, return_index=True)[1])
        pair, distance = pair[once], distance[once]
        return Points(pair, place[once], normal[once], distance, self._asked(pair, distance))

    def _asked(self, pair: Places, distance: Array) -> NDArray[np.bool_]:
        """Of two boxes only four points have rows, the nearest among them; of others all."""
        least = np.full(len(self.which), np.inf)
        np.minimum.at(least, pair, distance)
        first = distance <= least[pair] + TIED
        count = np.bincount(pair[first], minlength=len(self.which))
        return np.asarray(~self.edged[pair] | (first & (count[pair] == 1)))


def _near_edges(excess: Array, edges: Places, spread: float) -> NDArray[np.bool_]:
    """Which edges may be as near as the nearest corner and a spread, (p, e).

    Args:
        excess: how far corners are beyond the faces of the other box, signed, (p, 8, 3) [m].
        edges: the corners that they join, (e, 2).
        spread: [m].
    """
    corner = np.linalg.norm(excess, axis=2).min(1)
    one, other = excess[:, edges[:, 0]], excess[:, edges[:, 1]]
    least = np.maximum(np.minimum(one, other), 0.0) + np.minimum(np.maximum(one, other), 0.0)
    return np.asarray(np.linalg.norm(least, axis=2) <= (corner + spread + ALONE)[:, None])
