"""Distances between capsules and rounded boxes, and the rows that keep them.

Of a pair, the first body's core is a segment a(s) = a0 + s·d, s in [0, 1]; the second one's is a
box. f(s), the distance from a(s) to the box, is convex. Rows are written for three points of the
segment: the nearest one, and both ends of {s: f(s) ≤ min f + spread}. Where the nearest points
are not unique, as between parallel capsules, the ends are what keeps the pair from tilting into
each other, and they move continuously with the pair; each row is the exact derivative of the
distance of one point of the segment.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from protocol.compilation import inlined, kernel
from protocol.messages import FloatArray

ROOM_HALVINGS = 60  # of the search for the margin up to which there is room
WITNESSES = 3  # rows that a pair can have
HALVINGS = 32  # of [0, 1], towards the nearest point
ROUGH_HALVINGS = 20  # towards an end: its row is exact wherever it lies
SAME = 1e-9  # of s: the same point of the segment
IMMOVABLE = 1e-12  # m/rad: no joint changes the distance


@inlined
def _outside(x: float, half: float) -> float:
    """Signed excess of a coordinate over [−half, half]."""
    return x - half if x > half else (x + half if x < -half else 0.0)


@inlined
def _gap(a0: FloatArray, d: FloatArray, half: FloatArray, s: float) -> float:
    """f(s): distance from a(s) to a box, all in the box's axes."""
    x = _outside(a0[0] + s * d[0], half[0])
    y = _outside(a0[1] + s * d[1], half[1])
    z = _outside(a0[2] + s * d[2], half[2])
    return math.sqrt(x * x + y * y + z * z)


@inlined
def _slope(a0: FloatArray, d: FloatArray, half: FloatArray, s: float) -> float:
    """d(f²/2)/ds, which never decreases with s."""
    slope = 0.0
    for i in range(3):
        slope += _outside(a0[i] + s * d[i], half[i]) * d[i]
    return slope


@inlined
def _nearest(a0: FloatArray, d: FloatArray, half: FloatArray) -> float:
    """The first s in [0, 1] at which f is least."""
    if _slope(a0, d, half, 0.0) >= 0.0:
        return 0.0
    if _slope(a0, d, half, 1.0) < 0.0:
        return 1.0
    below, above = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = (below + above) / 2
        if _slope(a0, d, half, middle) < 0.0:
            below = middle
        else:
            above = middle
    return above


@inlined
def _edge(
    a0: FloatArray, d: FloatArray, half: FloatArray, inner: float, end: float, level: float
) -> float:
    """The s between `inner`, where f ≤ level, and `end` at which f reaches the level."""
    if _gap(a0, d, half, end) <= level:
        return end
    inside, outside = inner, end
    for _ in range(ROUGH_HALVINGS):
        middle = (inside + outside) / 2
        if _gap(a0, d, half, middle) <= level:
            inside = middle
        else:
            outside = middle
    return inside


@inlined
def _witness(
    a0: FloatArray, d: FloatArray, half: FloatArray, s: float, normal: FloatArray
) -> tuple[float, bool]:
    """Signed distance from a(s) to the box, and its gradient in the box's axes.

    Inside the box it is minus the way to the nearest face.

    Returns:
        The distance [m], and whether a(s) is inside.
    """
    for i in range(3):
        normal[i] = _outside(a0[i] + s * d[i], half[i])
    distance = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if distance > 1e-12:
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


@inlined
def _relative(
    origin: FloatArray,
    rotation: FloatArray,
    capsule: tuple[FloatArray, FloatArray, FloatArray],
    box_origin: FloatArray,
    turn: FloatArray,
    a0_out: FloatArray,
    d_out: FloatArray,
) -> None:
    """Write a0 and d of a capsule in a box's axes.

    Args:
        origin, rotation: (3,) [m], (3, 3) of the capsule's frame.
        capsule: its center, axes and half extents in that frame.
        box_origin, turn: (3,) [m], (3, 3) of the box's own axes.
        a0_out, d_out: (3,) [m].
    """
    center, axes, half = capsule
    a0_out[:], d_out[:] = 0.0, 0.0
    for i in range(3):
        middle, along = origin[i] - box_origin[i], 0.0
        for j in range(3):
            middle += rotation[i, j] * center[j]
            along += rotation[i, j] * axes[j, 2]
        for k in range(3):
            a0_out[k] += turn[i, k] * (middle - half[2] * along)
            d_out[k] += turn[i, k] * 2.0 * half[2] * along


@inlined
def _pose(
    origin: FloatArray,
    rotation: FloatArray,
    center: FloatArray,
    axes: FloatArray,
    origin_out: FloatArray,
    turn_out: FloatArray,
) -> None:
    """Write the origin and the axes of a body that is fixed to a frame, as seen by all."""
    for i in range(3):
        origin_out[i] = origin[i]
        for j in range(3):
            origin_out[i] += rotation[i, j] * center[j]
            turn_out[i, j] = 0.0
            for k in range(3):
                turn_out[i, j] += rotation[i, k] * axes[k, j]


@inlined
def _approach(
    point: FloatArray,
    normal: FloatArray,
    first: tuple[FloatArray, FloatArray],
    second: tuple[FloatArray, FloatArray],
    row_out: FloatArray,
) -> float:
    """Write −n·(v_first − v_second) at a point, by joint; return the largest |element|.

    Args:
        point: (3,) [m].
        normal: (3,) unit, from the second body to the first.
        first, second: origin (3,) [m] and Jacobian (6, n) of their frames.
        row_out: (n,) [m/rad].
    """
    top = 0.0
    origin_a, jacobian_a = first
    origin_b, jacobian_b = second
    for joint in range(row_out.size):
        rate = 0.0
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            arm_a = (point[j] - origin_a[j]) * normal[k] - (point[k] - origin_a[k]) * normal[j]
            arm_b = (point[j] - origin_b[j]) * normal[k] - (point[k] - origin_b[k]) * normal[j]
            rate += normal[i] * (jacobian_a[i, joint] - jacobian_b[i, joint])
            rate += arm_a * jacobian_a[3 + i, joint] - arm_b * jacobian_b[3 + i, joint]
        row_out[joint] = -rate
        top = max(top, abs(rate))
    return top


@inlined
def _bound(margin: float, eta: float, reserve: float, return_speed: float) -> float:
    """Right-hand side of a row: never negative inside, limited outside."""
    if margin >= 0.0:
        return eta * max(margin - reserve, 0.0)
    return max(eta * margin, -return_speed)


@inlined
def _count_below(margins: FloatArray, limit: float) -> int:
    count = 0
    for margin in margins:
        count += margin < limit
    return count


@inlined
def _reach(margins: FloatArray, activation: float, room: int) -> tuple[float, int]:
    """The margin below which pairs get rows, and how many find no room: the furthest do not."""
    near = _count_below(margins, activation)
    if near <= room:
        return activation, 0
    least = activation
    for margin in margins:
        least = min(least, margin)
    limit, beyond = least, activation
    for _ in range(ROOM_HALVINGS):
        middle = 0.5 * (limit + beyond)
        if _count_below(margins, middle) > room:
            beyond = middle
        else:
            limit = middle
    return limit, near - _count_below(margins, limit)


@kernel(
    "Tuple((i8, i8, i8, i8))(f8[:,::1], f8[:,:,::1], f8[:,:,::1], i8[::1], f8[:,::1],"
    " f8[:,:,::1], f8[:,::1], f8[::1], i8[:,::1], f8[::1], f8[::1], f8[:,::1], f8[::1])"
)
def distance_rows(
    origins: FloatArray,
    rotations: FloatArray,
    jacobians: FloatArray,
    frame_of: NDArray[np.int64],
    centers: FloatArray,
    axes: FloatArray,
    halves: FloatArray,
    radii: FloatArray,
    pairs: NDArray[np.int64],
    settings: FloatArray,
    margins_out: FloatArray,
    A_out: FloatArray,
    b_out: FloatArray,
) -> tuple[int, int, int, int]:
    """Write the margin of every pair, and rows for those that are near.

    Args:
        origins, rotations, jacobians: (F, 3) [m], (F, 3, 3), (F, 6, n) of each frame: velocity
            of the origin, then angular velocity; all as seen from one frame.
        frame_of: (B,) frame of each body.
        centers, axes, halves, radii: (B, 3), (B, 3, 3), (B, 3), (B,) the bodies in their frames.
        pairs: (P, 2) bodies; the first is a capsule or a sphere.
        settings: clearance [m], activation [m], spread [m], η [1/s], reserve [m], return
            speed [m/s].
        margins_out: (P,) distance less clearance [m].
        A_out, b_out: (R, n), (R,) −∇m·u ≤ b; unused rows 0·u ≤ inf.

    Returns:
        Rows written, pairs left without rows though near, pairs whose cores cross, and rows
        left out because no joint moves them though they lie outside.
    """
    clearance, activation, spread = settings[0], settings[1], settings[2]
    count, row, crossing, immovable = pairs.shape[0], 0, 0, 0
    a0, d, nearest = np.empty((count, 3)), np.empty((count, 3)), np.empty(count)
    centers_b, turns = np.empty((count, 3)), np.empty((count, 3, 3))
    normal, seen, point = np.empty(3), np.empty(3), np.empty(3)
    for p in range(count):
        a, b = pairs[p, 0], pairs[p, 1]
        fa, fb = frame_of[a], frame_of[b]
        _pose(origins[fb], rotations[fb], centers[b], axes[b], centers_b[p], turns[p])
        capsule = (centers[a], axes[a], halves[a])
        _relative(origins[fa], rotations[fa], capsule, centers_b[p], turns[p], a0[p], d[p])
        nearest[p] = _nearest(a0[p], d[p], halves[b])
        distance, inside = _witness(a0[p], d[p], halves[b], nearest[p], normal)
        crossing += inside
        margins_out[p] = distance - radii[a] - radii[b] - clearance
    limit, short = _reach(margins_out, activation, b_out.size // WITNESSES)
    A_out[:, :], b_out[:] = 0.0, math.inf
    for p in range(count):
        if not margins_out[p] < limit:
            continue
        a, b = pairs[p, 0], pairs[p, 1]
        fa, fb = frame_of[a], frame_of[b]
        level = _gap(a0[p], d[p], halves[b], nearest[p]) + spread
        for w in range(WITNESSES):
            s = nearest[p]
            if w > 0:
                s = _edge(a0[p], d[p], halves[b], nearest[p], w - 1.0, level)
                if abs(s - nearest[p]) < SAME:
                    continue
            distance, _ = _witness(a0[p], d[p], halves[b], s, normal)
            for i in range(3):
                seen[i], point[i] = 0.0, centers_b[p, i]
                for k in range(3):
                    seen[i] += turns[p, i, k] * normal[k]
                    point[i] += turns[p, i, k] * (a0[p, k] + s * d[p, k])
            first, second = (origins[fa], jacobians[fa]), (origins[fb], jacobians[fb])
            top = _approach(point, seen, first, second, A_out[row])
            margin = distance - radii[a] - radii[b] - clearance
            b_out[row] = _bound(margin, settings[3], settings[4], settings[5])
            if top < IMMOVABLE:
                immovable += b_out[row] < 0.0
                A_out[row, :], b_out[row] = 0.0, math.inf
            else:
                row += 1
    return row, short, crossing, immovable
