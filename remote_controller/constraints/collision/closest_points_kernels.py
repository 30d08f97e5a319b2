"""The points of a pair that get rows: those that are nearest, or nearly so.

They are up to three points of every segment that comes as near as the pair's distance and a spread:
the nearest one, and both ends of {s: f(s) ≤ distance + spread}. Where the nearest points are not
unique, as between parallel capsules or faces, the ends are what keeps the pair from tilting into
each other, and they move continuously with the pair. Of two boxes no more than four remain: what
they span is nearly what all of them do.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined
from hoap3.remote_controller.constraints.collision.box_edges_kernels import (
    CORE,
    EDGES,
    ENDS,
    STARTS,
    corners,
    segment,
)
from hoap3.remote_controller.constraints.collision.frame_transforms_kernels import apart, into
from hoap3.remote_controller.constraints.collision.segment_box_kernels import edge, squared, witness

WITNESSES = 3  # points of a segment that can have rows
CONTACTS = 4  # points of two boxes that can
STEEP = 5.0  # spreads: an end nearer than that binds only where the pair turns faster than η/5
TINY = 1e-12  # m: the length of a point
SAME = 1e-7  # m: two nearest points are the same where their middles are


@inlined
def _at(
    middle: FloatArray,
    turn: FloatArray,
    a0: FloatArray,
    d: FloatArray,
    s: float,
    normal: FloatArray,
    point_out: FloatArray,
    normal_out: FloatArray,
) -> None:
    """Write a(s) and a normal, given in a box's axes, in the root's."""
    for i in range(3):
        point_out[i], normal_out[i] = middle[i], 0.0
        for k in range(3):
            point_out[i] += turn[i, k] * (a0[k] + s * d[k])
            normal_out[i] += turn[i, k] * normal[k]


@inlined
def _distinct(found: FloatArray, count: int) -> int:
    """Keep the first of what are the same nearest points; return how many are left."""
    kept = 0
    for i in range(count):
        known = False
        for j in range(kept):
            away = 0.0
            for k in range(3):
                gap = found[i, k] - found[j, k]
                gap -= 0.5 * (found[i, 6] * found[i, 3 + k] - found[j, 6] * found[j, 3 + k])
                away = max(away, abs(gap))
            known |= away < SAME
        if not known:
            if kept < i:
                for k in range(7):
                    found[kept, k] = found[i, k]
            kept += 1
    return kept


@inlined
def _swap(rows: FloatArray, one: int, other: int) -> None:
    for k in range(rows.shape[1]):
        rows[one, k], rows[other, k] = rows[other, k], rows[one, k]


@inlined
def _area(found: FloatArray, i: int) -> float:
    """Twice the signed area of the points 0, 1 and i, seen along the normal of the first [m²]."""
    ax, ay, az = (
        found[1, 0] - found[0, 0],
        found[1, 1] - found[0, 1],
        found[1, 2] - found[0, 2],
    )
    bx, by, bz = (
        found[i, 0] - found[0, 0],
        found[i, 1] - found[0, 1],
        found[i, 2] - found[0, 2],
    )
    nx, ny, nz = found[0, 3], found[0, 4], found[0, 5]
    area: float = nx * (ay * bz - az * by) + ny * (az * bx - ax * bz) + nz * (ax * by - ay * bx)
    return area


@inlined
def _reduce(found: FloatArray, count: int) -> int:
    """Bring the nearest point to the front, and behind it the three that reach farthest around it.

    They are the one farthest from it, and on both sides of the line of these two the one that is
    farthest from the line. Returns how many remain: four at most.
    """
    best = 0
    for i in range(1, count):
        if found[i, 6] < found[best, 6]:
            best = i
    _swap(found, 0, best)
    if count <= CONTACTS:
        return count
    best, top = 1, -1.0
    for i in range(1, count):
        away = apart(found[i], found[0])
        if away > top:
            best, top = i, away
    _swap(found, 1, best)
    for place, side in ((2, 1.0), (3, -1.0)):
        best, top = place, -math.inf
        for i in range(place, count):
            area = side * _area(found, i)
            if area > top:
                best, top = i, area
        _swap(found, place, best)
    return CONTACTS


@inlined
def contact_points(
    placed: tuple[FloatArray, FloatArray],
    halves: FloatArray,
    pair: NDArray[np.int64],
    nearest_s: FloatArray,
    reach: float,
    spread: float,
    scratch: tuple[FloatArray, ...],
    found_out: FloatArray,
) -> int:
    """Write the points of a pair that get rows; return how many.

    Args:
        placed, halves: of the bodies.
        pair: as of `distance_rows`.
        nearest_s: (2, 12, 2) as `distance_kernels` finds them.
        reach: how near they come [m].
        spread: as of `distance_rows` [m].
        scratch: overwritten.
        found_out: (at least 72, 7) the point, n from the second core of the pair to the first,
            and the distance of the cores there; in the root's axes.
    """
    middles, turns = placed
    centers, locals_, points, _, a0, d, normal = scratch
    count, edged, level = 0, pair[2] != 0, reach * reach
    for side in range(2 if edged else 1):
        first, second = pair[side], pair[1 - side]
        half, outward, ready, seen = halves[second], 1.0 - 2.0 * side, False, 0
        for number in range(0 if edged else CORE, EDGES if edged else CORE + 1):
            if nearest_s[side, number, 1] > reach:
                continue
            if not ready:
                into(placed, first, second, centers[0], locals_[0])
                corners(centers[0], locals_[0], halves[first], points[0])
                ready = True
            inner = nearest_s[side, number, 0]
            segment(points[0], number, a0, d)
            away = STEEP * spread / max(math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), TINY)
            for w in range(WITNESSES):
                s = inner
                if w > 0:
                    s = min(inner + away, 1.0) if w == 2 else max(inner - away, 0.0)
                    if s == inner or squared(a0, d, half, s) > level:
                        continue
                    s = edge(a0, d, half, inner, w - 1.0, level)
                if not 0.0 < s < 1.0:  # a corner, which three edges share
                    corner = 1 << (ENDS[number] if s >= 1.0 else STARTS[number])
                    if seen & corner:
                        continue
                    seen |= corner
                new = found_out[count]
                new[6], _ = witness(a0, d, half, s, normal)
                _at(middles[second], turns[second], a0, d, s, normal, new[:3], new[3:6])
                for k in range(3, 6):
                    new[k] *= outward
                count += 1
    return _distinct(found_out, _reduce(found_out, count))
