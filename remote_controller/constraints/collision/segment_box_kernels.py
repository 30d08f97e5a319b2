"""The distance of a segment from a box: where it is least, and how it changes along the segment.

A segment is a box's edge or a capsule's core, and a point is one without length. It is
a(s) = a0 + s·d, s in [0, 1], in the box's axes; the box is |x_i| ≤ half_i. f(s), the distance
from a(s) to the box, is convex, and f² is quadratic between the points where a(s) passes the
plane of a face: six at most, two of a box with an extent along one axis only.
"""

from __future__ import annotations

import math

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined

TOUCHING = 1e-12  # m: what is nearer is inside


@inlined
def _outside(x: float, half: float) -> float:
    """Signed excess of a coordinate over [−half, half]."""
    return x - half if x > half else (x + half if x < -half else 0.0)


@inlined
def squared(a0: FloatArray, d: FloatArray, half: FloatArray, s: float) -> float:
    """f(s)²: squared distance from a(s) to a box, all in the box's axes."""
    squared = 0.0
    for i in range(3):
        out = _outside(a0[i] + s * d[i], half[i])
        squared += out * out
    return squared


@inlined
def _slope(a0: FloatArray, d: FloatArray, half: FloatArray, s: float) -> float:
    """d(f²/2)/ds, which never decreases with s."""
    slope = 0.0
    for i in range(3):
        slope += _outside(a0[i] + s * d[i], half[i]) * d[i]
    return slope


@inlined
def nearest(a0: FloatArray, d: FloatArray, half: FloatArray) -> float:
    """An s in [0, 1] at which f is least: the first one, or the middle of what is in the box."""
    s = _first(a0, d, half)
    if squared(a0, d, half, s) > TOUCHING * TOUCHING:
        return s
    enter, leave = 0.0, 1.0
    for i in range(3):
        if d[i] != 0.0:
            one, other = (-half[i] - a0[i]) / d[i], (half[i] - a0[i]) / d[i]
            enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
    return 0.5 * (enter + leave) if enter < leave else s


@inlined
def _first(a0: FloatArray, d: FloatArray, half: FloatArray) -> float:
    """The first s in [0, 1] at which f is least."""
    below, above = 0.0, 1.0
    falling, rising = _slope(a0, d, half, below), _slope(a0, d, half, above)
    if falling >= 0.0:
        return 0.0
    if rising < 0.0:
        return 1.0
    for face in range(6):
        i = face % 3
        room = (half[i] if face < 3 else -half[i]) - a0[i]
        if half[i] == 0.0 or not 0.0 < room * d[i] < d[i] * d[i]:
            continue  # no kink, or not between the ends
        s = room / d[i]
        if below < s < above:
            slope = _slope(a0, d, half, s)
            if slope < 0.0:
                below, falling = s, slope
            else:
                above, rising = s, slope
    return min(max(below + (above - below) * falling / (falling - rising), 0.0), 1.0)


@inlined
def edge(
    a0: FloatArray, d: FloatArray, half: FloatArray, inner: float, end: float, level: float
) -> float:
    """The s between `inner`, where f² ≤ level, and `end` at which f² reaches the level."""
    if inner == end or squared(a0, d, half, end) <= level:
        return end
    inside, outside = inner, end
    for face in range(6):
        i = face % 3
        if d[i] == 0.0 or half[i] == 0.0:
            continue
        s = ((half[i] if face < 3 else -half[i]) - a0[i]) / d[i]
        if min(inside, outside) < s < max(inside, outside):
            if squared(a0, d, half, s) <= level:
                inside = s
            else:
                outside = s
    # f² is quadratic in between: room = 2·slope·x + bend·x²
    way = outside - inside
    slope = _slope(a0, d, half, inside)
    bend = (_slope(a0, d, half, outside) - slope) / way
    slope = slope if way > 0.0 else -slope
    room = max(level - squared(a0, d, half, inside), 0.0)
    share = slope + math.sqrt(max(slope * slope + bend * room, 0.0))
    if share <= 0.0:
        return inside
    x = min(room / share, abs(way))
    return inside + x if way > 0.0 else inside - x


@inlined
def witness(
    a0: FloatArray, d: FloatArray, half: FloatArray, s: float, normal: FloatArray
) -> tuple[float, bool]:
    """Signed distance from a(s) to the box, and its gradient in the box's axes.

    Inside the box it is minus the way to the nearest face. Of a segment that crosses the box,
    `nearest` gives the middle of the part inside, at least half as deep as its deepest point.

    Returns:
        The distance [m], and whether a(s) is inside.
    """
    for i in range(3):
        normal[i] = _outside(a0[i] + s * d[i], half[i])
    distance = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if distance > TOUCHING:
        for i in range(3):
            normal[i] /= distance
        return distance, False
    face, depth = 0, math.inf
    for i in range(3):
        normal[i] = 0.0
        if half[i] - abs(a0[i] + s * d[i]) < depth:
            face, depth = i, half[i] - abs(a0[i] + s * d[i])
    normal[face] = 1.0 if a0[face] + s * d[face] >= 0.0 else -1.0
    return -max(depth, 0.0), True
