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
from remote_controller.constraints.segment_box_kernels import edge, nearest, squared, witness

ROOM_HALVINGS = 60  # of the search for the margin up to which there is room
WITNESSES = 3  # rows that a pair can have
SAME = 1e-9  # of s: the same point of the segment
UNKNOWN = -1.0  # s of a pair that was not looked at: its bounding balls are far apart
IMMOVABLE = 1e-12  # m/rad: no joint changes the distance


@inlined
def _place(
    origin: FloatArray,
    rotation: FloatArray,
    center: FloatArray,
    axes: FloatArray,
    center_out: FloatArray,
    turn_out: FloatArray,
) -> None:
    """Write where a body that is fixed to a frame is in the root's axes."""
    for i in range(3):
        center_out[i] = origin[i]
        for j in range(3):
            center_out[i] += rotation[i, j] * center[j]
            turn_out[i, j] = 0.0
            for k in range(3):
                turn_out[i, j] += rotation[i, k] * axes[k, j]


@inlined
def _apart(first: FloatArray, second: FloatArray) -> float:
    """Distance of two points [m]."""
    x, y, z = first[0] - second[0], first[1] - second[1], first[2] - second[2]
    return math.sqrt(x * x + y * y + z * z)


@inlined
def _into_box(
    center: FloatArray,
    turn: FloatArray,
    length: float,
    box_center: FloatArray,
    box_turn: FloatArray,
    a0_out: FloatArray,
    d_out: FloatArray,
) -> None:
    """Write a0 and d of a segment along its own z in a box's axes [m]."""
    for k in range(3):
        middle, along = 0.0, 0.0
        for i in range(3):
            middle += box_turn[i, k] * (center[i] - box_center[i])
            along += box_turn[i, k] * turn[i, 2]
        a0_out[k] = middle - 0.5 * length * along
        d_out[k] = length * along


@inlined
def _approach(
    point: FloatArray,
    normal: FloatArray,
    twists: FloatArray,
    carried: FloatArray,
    row_out: FloatArray,
) -> float:
    """Write −n·(v_first − v_second) at a point, by joint; return the largest |element|.

    A joint gives what it carries v + ω × p at p, and n·(ω × p) = ω·(p × n).

    Args:
        point: (3,) p [m].
        normal: (3,) n, unit, from the second body to the first.
        twists: (n, 6) v and ω of each joint.
        carried: (n,) 1 where a joint carries the first body alone, −1 the second alone, else 0.
        row_out: (n,) [m/rad].
    """
    nx, ny, nz = normal[0], normal[1], normal[2]
    mx, my, mz = (
        point[1] * nz - point[2] * ny,
        point[2] * nx - point[0] * nz,
        point[0] * ny - point[1] * nx,
    )
    top = 0.0
    for joint in range(carried.size):
        if carried[joint] == 0.0:
            row_out[joint] = 0.0
            continue
        twist = twists[joint]
        rate = nx * twist[0] + ny * twist[1] + nz * twist[2]
        rate += mx * twist[3] + my * twist[4] + mz * twist[5]
        row_out[joint] = -carried[joint] * rate
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


@inlined
def _lay_out(
    frames: tuple[FloatArray, FloatArray],
    frame_of: NDArray[np.int64],
    bodies: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    middles_out: FloatArray,
    turns_out: FloatArray,
    balls_out: FloatArray,
) -> None:
    """Write where all bodies are, and the radii of the balls around them."""
    origins, rotations = frames
    centers, axes, halves, radii = bodies
    for body in range(frame_of.size):
        x, y, z = halves[body, 0], halves[body, 1], halves[body, 2]
        balls_out[body] = radii[body] + math.sqrt(x * x + y * y + z * z)
        frame = frame_of[body]
        _place(
            origins[frame],
            rotations[frame],
            centers[body],
            axes[body],
            middles_out[body],
            turns_out[body],
        )


@inlined
def _measure(
    placed: tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray],
    pairs: NDArray[np.int64],
    clearance: float,
    activation: float,
    segments_out: tuple[FloatArray, FloatArray, FloatArray],
    margins_out: FloatArray,
) -> tuple[float, int]:
    """Write margins, and the segments of pairs that may be near; the least margin, and crossings.

    Args:
        placed: middles, turns, balls, halves and radii of the bodies.
        pairs, clearance, activation, margins_out: as of `distance_rows`.
        segments_out: a0 (P, 3) and d (P, 3) in the box's axes, and the s that is nearest (P,).
    """
    middles, turns, balls, halves, radii = placed
    a0, d, nearest_s = segments_out
    normal, least, crossing = np.empty(3), math.inf, 0
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        nearest_s[p] = UNKNOWN
        margins_out[p] = _apart(middles[a], middles[b]) - balls[a] - balls[b] - clearance
    for beyond in (False, True):  # the smallest margin may be beyond the activation
        for p in range(pairs.shape[0]):
            if nearest_s[p] != UNKNOWN or margins_out[p] >= (least if beyond else activation):
                continue
            a, b = pairs[p, 0], pairs[p, 1]
            length = 2.0 * halves[a, 2]
            _into_box(middles[a], turns[a], length, middles[b], turns[b], a0[p], d[p])
            nearest_s[p] = nearest(a0[p], d[p], halves[b])
            distance, inside = witness(a0[p], d[p], halves[b], nearest_s[p], normal)
            crossing += inside
            margins_out[p] = distance - radii[a] - radii[b] - clearance
            least = min(least, margins_out[p])
    return least, crossing


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


@kernel(
    "Tuple((f8, i8, i8, i8))(f8[:,:], f8[:,:,:], f8[:,:], i8[::1], i8[::1], f8[:,::1],"
    " f8[:,:,::1], f8[:,::1], f8[::1], i8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[:,::1],"
    " f8[::1])"
)
def distance_rows(
    origins: FloatArray,
    rotations: FloatArray,
    twists: FloatArray,
    order: NDArray[np.int64],
    frame_of: NDArray[np.int64],
    centers: FloatArray,
    axes: FloatArray,
    halves: FloatArray,
    radii: FloatArray,
    pairs: NDArray[np.int64],
    carried: FloatArray,
    settings: FloatArray,
    margins_out: FloatArray,
    A_out: FloatArray,
    b_out: FloatArray,
) -> tuple[float, int, int, int]:
    """Write the margin of every pair, and rows for those that are near.

    Args:
        origins, rotations: (F, 3) [m], (F, 3, 3) of all frames, in the root's axes.
        twists: (6, n) velocity at the root's origin and angular velocity that each joint gives,
            in Pinocchio's order.
        order: (n,) column of each joint of the wire.
        frame_of: (B,) frame of each body.
        centers, axes, halves, radii: (B, 3), (B, 3, 3), (B, 3), (B,) the bodies in their frames.
        pairs: (P, 2) bodies; the first is a capsule or a sphere.
        carried: (P, n) 1 where a joint carries the first of a pair alone, −1 the second, else 0.
        settings: clearance [m], activation [m], spread [m], η [1/s], reserve [m], return
            speed [m/s].
        margins_out: (P,) distance less clearance [m]; of pairs further than the activation, the
            smallest excepted, it may be that of the balls around them, which is less.
        A_out, b_out: (R, n), (R,) −∇m·u ≤ b; unused rows 0·u ≤ inf.

    Returns:
        The smallest margin (inf without pairs), pairs left without rows though near, pairs whose
        cores cross, and rows left out because no joint moves them though they lie outside.
    """
    clearance, activation, spread = settings[0], settings[1], settings[2]
    bodies, count, row, immovable = frame_of.size, pairs.shape[0], 0, 0
    middles, turns, balls = np.empty((bodies, 3)), np.empty((bodies, 3, 3)), np.empty(bodies)
    a0, d, nearest_s = np.empty((count, 3)), np.empty((count, 3)), np.empty(count)
    local, seen, point = np.empty(3), np.empty(3), np.empty(3)
    _lay_out((origins, rotations), frame_of, (centers, axes, halves, radii), middles, turns, balls)
    placed, segments = (middles, turns, balls, halves, radii), (a0, d, nearest_s)
    least, crossing = _measure(placed, pairs, clearance, activation, segments, margins_out)
    limit, short = _reach(margins_out, activation, b_out.size // WITNESSES)
    by_joint = twists.T[order]
    A_out[:, :], b_out[:] = 0.0, math.inf
    for p in range(count):
        if not margins_out[p] < limit:
            continue
        a, b = pairs[p, 0], pairs[p, 1]
        level = (math.sqrt(squared(a0[p], d[p], halves[b], nearest_s[p])) + spread) ** 2
        for w in range(WITNESSES):
            s = nearest_s[p]
            if w > 0:
                s = edge(a0[p], d[p], halves[b], nearest_s[p], w - 1.0, level)
                if abs(s - nearest_s[p]) < SAME:
                    continue
            distance, _ = witness(a0[p], d[p], halves[b], s, local)
            _at(middles[b], turns[b], a0[p], d[p], s, local, point, seen)
            top = _approach(point, seen, by_joint, carried[p], A_out[row])
            margin = distance - radii[a] - radii[b] - clearance
            b_out[row] = _bound(margin, settings[3], settings[4], settings[5])
            if top < IMMOVABLE:
                immovable += b_out[row] < 0.0
                A_out[row, :], b_out[row] = 0.0, math.inf
            else:
                row += 1
    return least, short, crossing, immovable
