"""Distances between rounded boxes, and the rows that keep them.

All is reduced to segments a(s) = a0 + s·d, s in [0, 1], against boxes: f(s), the distance from a(s)
to the box, is convex. Of a pair with a sphere or a capsule, that one's core is the segment. Of two
boxes, the edges of each are held against the other: where they are apart, their nearest points can
be chosen so that one of them lies on an edge (the set of nearest points is a point, a segment or a
polygon, and its corners are corners of a box or crossings of two edges), and where they overlap,
some edge of one is partly inside the other.

Rows are written for up to three points of such a segment, of two boxes for up to four points of all
(`closest_points_kernels`); each row is the exact derivative of the distance of one point of the
segment.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined, kernel
from hoap3.remote_controller.constraints.collision.box_edges_kernels import (
    CORE,
    EDGES,
    at_least,
    beside,
    corners,
    edge_at_least,
    segment,
)
from hoap3.remote_controller.constraints.collision.closest_points_kernels import (
    WITNESSES,
    contact_points,
)
from hoap3.remote_controller.constraints.collision.frame_transforms_kernels import (
    apart,
    into,
    lay_out,
    turn_round,
)
from hoap3.remote_controller.constraints.collision.segment_box_kernels import nearest, witness

ALONE = 1e-12  # m: beyond the nearest point, where it alone gets a row; for rounding
IMMOVABLE = 1e-12  # m/rad: no joint changes the distance

CLEARANCE, ACTIVATION, SPREAD, ETA, RESERVE, RETURN_SPEED, CONTACT = 0, 1, 2, 3, 4, 5, 6
"""Places in `settings`: see `distance_rows`."""

CORES = 6  # column of `found` with the distance of the cores; a point and n, three each, before it
PAIR, POINT, MARGIN, CORES_THERE = 0, 1, 7, 8  # columns of `contacts_out`; 1 to 6 as of `found`


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
def _sort(places: NDArray[np.int64], by: FloatArray) -> None:
    """Sort places in `by` by what is there; what is equal keeps its order."""
    for i in range(1, places.size):
        moved, j = places[i], i
        while j > 0 and by[places[j - 1]] > by[moved]:
            places[j] = places[j - 1]
            j -= 1
        places[j] = moved


@inlined
def _cores(
    placed: tuple[FloatArray, FloatArray],
    halves: FloatArray,
    pair: NDArray[np.int64],
    limit: float,
    contact: float,
    spread: float,
    scratch: tuple[FloatArray, ...],
    nearest_out: FloatArray,
) -> tuple[float, bool]:
    """Distance of the cores of a pair, and whether they cross.

    What is found to be more than the limit may be a lower bound.

    Args:
        placed, halves: of the bodies.
        pair: as of `distance_rows`.
        limit: [m].
        contact: distance of the cores below which `nearest_out` is needed up to the spread [m].
        spread: as of `distance_rows` [m].
        scratch: overwritten: places of two bodies in each other's axes, (2, 3) and (2, 3, 3), their
            corners, (2, 8, 3), how far these are beyond the other body, (2, 8, 3), and a0, d and
            the normal of a segment, (3,).
        nearest_out: (2, 12, 2) s at which an edge of the first, or second, body is nearest to the
            other one, and its distance there; a distance of inf where it is greater than that of
            the pair by more than the spread.
    """
    centers, turns, points, excess, a0, d, normal = scratch
    edged = pair[2] != 0
    sides = 2 if edged else 1
    into(placed, pair[0], pair[1], centers[0], turns[0])
    if edged:
        turn_round(centers[0], turns[0], centers[1], turns[1])
        bound = 0.0
        for side in range(sides):
            half, other = halves[pair[side]], halves[pair[1 - side]]
            bound = max(bound, at_least(centers[side], turns[side], half, other))
        if limit >= 0.0 and bound > limit * limit:
            return math.sqrt(bound), False
    nearest_out[:, :, 1] = math.inf
    top = math.inf
    for side in range(sides):
        corners(centers[side], turns[side], halves[pair[side]], points[side])
        top = min(top, beside(points[side], halves[pair[1 - side]], excess[side]))
    least, crossing = math.inf, False
    for again in (False, True):  # the nearest; then, of pairs in contact, the nearly nearest
        if again and least >= contact:
            break
        level = (max(least, 0.0) + spread) ** 2 if again else top
        for side in range(sides):
            half, places, beyond = halves[pair[1 - side]], points[side], excess[side]
            for number in range(0 if edged else CORE, EDGES if edged else CORE + 1):
                known = again and nearest_out[side, number, 1] < math.inf
                if known or edge_at_least(beyond, number) > level:
                    continue
                segment(places, number, a0, d)
                s = nearest(a0, d, half)
                distance, inside = witness(a0, d, half, s, normal)
                nearest_out[side, number, 0], nearest_out[side, number, 1] = s, distance
                crossing |= inside
                least = min(least, distance)
                if not again:
                    level = min(level, max(least, 0.0) ** 2)
    return least, crossing


@inlined
def _measure(
    placed: tuple[FloatArray, FloatArray],
    bodies: tuple[FloatArray, FloatArray, FloatArray],
    pairs: NDArray[np.int64],
    settings: FloatArray,
    scratch: tuple[FloatArray, ...],
    nearest_out: FloatArray,
    margins_out: FloatArray,
) -> tuple[float, int]:
    """Write margins; return the least, and how many pairs cross.

    Args:
        placed: middles and turns of the bodies.
        bodies: halves, radii and balls.
        pairs, settings, margins_out: as of `distance_rows`.
        scratch: overwritten.
        nearest_out: (P, 2, 12, 2), for each pair as of `_cores`.
    """
    middles, _ = placed
    clearance, activation, spread = settings[CLEARANCE], settings[ACTIVATION], settings[SPREAD]
    halves, radii, balls = bodies
    least, crossings = math.inf, 0
    exact = np.zeros(pairs.shape[0], np.bool_)
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        margins_out[p] = apart(middles[a], middles[b]) - balls[a] - balls[b] - clearance
    for beyond in (False, True):  # the smallest margin may be beyond the activation
        for p in range(pairs.shape[0]):
            limit = least if beyond else activation
            if exact[p] or margins_out[p] >= limit:
                continue
            around = radii[pairs[p, 0]] + radii[pairs[p, 1]] + clearance
            distance, crossing = _cores(
                placed,
                halves,
                pairs[p],
                limit + around,
                settings[CONTACT] + around,
                spread,
                scratch,
                nearest_out[p],
            )
            margins_out[p] = distance - around
            if distance < limit + around:
                exact[p], crossings = True, crossings + crossing
                least = min(least, margins_out[p])
    return least, crossings


@kernel(
    "Tuple((f8, i8, i8, i8))(f8[:,:], f8[:,:,:], f8[:,:], i8[::1], i8[::1], f8[:,::1],"
    " f8[:,:,::1], f8[:,::1], f8[::1], f8[::1], i8[:,::1], f8[:,::1], f8[::1], f8[::1],"
    " f8[:,::1], f8[::1], f8[:,::1])",
    allocates=True,
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
    balls: FloatArray,
    pairs: NDArray[np.int64],
    carried: FloatArray,
    settings: FloatArray,
    margins_out: FloatArray,
    A_out: FloatArray,
    b_out: FloatArray,
    contacts_out: FloatArray,
) -> tuple[float, int, int, int]:
    """Write the margin of every pair, and rows for those that are near.

    Args:
        origins, rotations: (F, 3) [m], (F, 3, 3) of all frames, in the root's axes.
        twists: (6, n) velocity at the root's origin and angular velocity that each joint gives,
            in Pinocchio's order.
        order: (n,) column of each joint of the wire.
        frame_of: (B,) frame of each body.
        centers, axes, halves, radii: (B, 3), (B, 3, 3), (B, 3), (B,) the bodies in their frames.
        balls: (B,) radii of the balls around them [m].
        pairs: (P, 3) two bodies, and whether both have edges; else the first has none.
        carried: (P, n) 1 where a joint carries the first of a pair alone, −1 the second, else 0.
        settings: (7,) `CLEARANCE` [m], `ACTIVATION` [m], `SPREAD` [m], `ETA` η [1/s], `RESERVE`
            [m], `RETURN_SPEED` [m/s], and `CONTACT`, the margin below which points within the
            spread have rows too [m].
        margins_out: (P,) distance less clearance [m]; of pairs further than the activation, the
            smallest excepted, it may be less.
        A_out, b_out: (R, n), (R,) −∇m·u ≤ b; unused rows 0·u ≤ inf. Where they are too few, the
            pairs with the smallest margins have them, of equal ones the first.
        contacts_out: (R, 9) of each row in use: its pair, the point (3) and n (3) in the root's
            axes, its margin [m] and the distance of the cores there [m]; the pair is −1 below them.

    Returns:
        The smallest margin (inf without pairs), pairs left without some of their rows, pairs
        whose cores cross, and rows left out because no joint moves them though they lie outside.
    """
    clearance, activation = settings[CLEARANCE], settings[ACTIVATION]
    spread, contact = settings[SPREAD], settings[CONTACT]
    eta, reserve = settings[ETA], settings[RESERVE]
    return_speed = settings[RETURN_SPEED]
    bodies = frame_of.size
    middles, turns = np.empty((bodies, 3)), np.empty((bodies, 3, 3))
    scratch = (
        *(np.empty((2, 3)), np.empty((2, 3, 3)), np.empty((2, 8, 3)), np.empty((2, 8, 3))),
        *(np.empty(3), np.empty(3), np.empty(3)),
    )
    nearest_s = np.empty((pairs.shape[0], 2, EDGES, 2))
    found = np.empty((2 * EDGES * WITNESSES, CORES + 1))
    lay_out((origins, rotations), frame_of, (centers, axes), middles, turns)
    placed, sizes = (middles, turns), (halves, radii, balls)
    least, crossing = _measure(placed, sizes, pairs, settings, scratch, nearest_s, margins_out)
    near = np.nonzero(margins_out < activation)[0]
    by_joint = twists.T[order]
    for _ in range(2):  # once more, the nearest first, where the rows are too few
        row, short, immovable = 0, 0, 0
        A_out[:, :], b_out[:], contacts_out[:, PAIR] = 0.0, math.inf, -1.0
        for p in near:
            around = radii[pairs[p, 0]] + radii[pairs[p, 1]] + clearance
            reach = max(margins_out[p] + around, 0.0)
            reach += spread if margins_out[p] < contact else ALONE
            count = 0
            if row < b_out.size:
                count = contact_points(
                    placed, halves, pairs[p], nearest_s[p], reach, spread, scratch, found
                )
            short += row + count > b_out.size or row == b_out.size
            for point in found[: min(count, b_out.size - row)]:
                top = _approach(point[:3], point[3:CORES], by_joint, carried[p], A_out[row])
                margin = point[CORES] - around
                b_out[row] = _bound(margin, eta, reserve, return_speed)
                if top < IMMOVABLE:
                    immovable += b_out[row] < 0.0
                    A_out[row, :], b_out[row] = 0.0, math.inf
                else:
                    contacts_out[row, PAIR], contacts_out[row, MARGIN] = p, margin
                    contacts_out[row, POINT:MARGIN] = point[:CORES]
                    contacts_out[row, CORES_THERE] = point[CORES]
                    row += 1
        if short == 0:
            break
        _sort(near, margins_out)
    return least, short, crossing, immovable
