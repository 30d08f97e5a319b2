"""How margins of distances bend along a motion, and rows of accelerations from it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.runtime.numba_jit import inlined, kernel
from hoap3.remote_controller.constraints.collision.box_edges_kernels import EDGES
from hoap3.remote_controller.constraints.collision.distance_kernels import _bound, _measure
from hoap3.remote_controller.constraints.collision.frame_transforms_kernels import lay_out
from hoap3.remote_controller.model.drift_kernels import carry, point_motion

NEAREST = 1e-9  # m: a row whose margin is that of its pair


@kernel(
    "void(f8[:,:], f8[:,:,:], i8[::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8[::1], f8[::1],"
    " i8[:,::1], f8[::1], f8[::1])",
    allocates=True,
)
def distance_margins(
    origins: FloatArray,
    rotations: FloatArray,
    frame_of: NDArray[np.int64],
    centers: FloatArray,
    axes: FloatArray,
    halves: FloatArray,
    radii: FloatArray,
    balls: FloatArray,
    pairs: NDArray[np.int64],
    settings: FloatArray,
    margins_out: FloatArray,
) -> None:
    """Write the margin of every pair, (P,) [m]; all arguments as of `distance_rows`."""
    bodies = frame_of.size
    middles, turns = np.empty((bodies, 3)), np.empty((bodies, 3, 3))
    scratch = (
        *(np.empty((2, 3)), np.empty((2, 3, 3)), np.empty((2, 8, 3)), np.empty((2, 8, 3))),
        *(np.empty(3), np.empty(3), np.empty(3)),
    )
    nearest_s = np.empty((pairs.shape[0], 2, EDGES, 2))
    lay_out((origins, rotations), frame_of, (centers, axes), middles, turns)
    placed, sizes = (middles, turns), (halves, radii, balls)
    _measure(placed, sizes, pairs, settings, scratch, nearest_s, margins_out)


@inlined
def _material(contact: FloatArray, twists: FloatArray, rates: FloatArray, side: int) -> float:
    """n·(p̈₁ − p̈₂) of the points of two bodies that face each other, where q̈ = 0.

    Args:
        contact: as of `distance_rows`; the point is on the first body (side 0) or the second.
        twists, rates: (2, 6) of the bodies, and how they change.
    """
    point, velocity, motion = np.empty(3), np.empty(3), np.empty(3)
    bend = 0.0
    for body in range(2):
        way = contact[8] * ((1.0 - body) if side == 1 else -1.0 * body)
        for k in range(3):
            point[k] = contact[1 + k] + way * contact[4 + k]
        point_motion(twists[body], rates[body], point, velocity, motion)
        sign = 1.0 - 2.0 * body
        for k in range(3):
            bend += sign * contact[4 + k] * motion[k]
    return bend


@kernel(
    "void(f8[:,::1], f8[:,:], i8[::1], f8[:,::1], f8[::1], f8[:,::1], f8, f8[::1], f8[:,::1],"
    " f8[::1])",
    allocates=True,
)
def distance_accelerations(
    contacts: FloatArray,
    twists: FloatArray,
    order: NDArray[np.int64],
    carried: FloatArray,
    dq: FloatArray,
    margins: FloatArray,
    epsilon: float,
    settings: FloatArray,
    A: FloatArray,
    upper_out: FloatArray,
) -> None:
    """Write the right-hand sides of A·q̈ ≤ 2ηṁ + η²(m − r) + m̈, m̈ being that where q̈ = 0.

    The nearest row of a pair has the pair's own m̈, 2(m(±ε) − m ∓ εṁ)/ε² on the side where it is
    greater: on the other one the nearest point may be another, for which there is a row of its
    own. Other rows have that of the points that face each other.

    Args:
        contacts, twists, order, carried, settings: as of `distance_rows`.
        dq: (n,) q̇ [rad/s or m/s].
        margins: (3, P) at q, q + εq̇ and q − εq̇ [m].
        epsilon: ε [s]; 0 where nothing moves.
        A: (R, n) −∇m.
        upper_out: (R,) [m/s²]; inf where a row is off.
    """
    eta, reserve, return_speed = settings[3], settings[4], settings[5]
    n, last = order.size, -1
    joint = np.empty(6)
    twist, rate, places = np.zeros((2, 6)), np.zeros((2, 6)), np.empty(n, np.int64)
    for i in range(n):
        places[order[i]] = i
    for row in range(upper_out.size):
        pair = int(contacts[row, 0])
        upper_out[row] = math.inf
        if pair < 0:
            continue
        speed = 0.0
        for i in range(n):
            speed -= A[row, i] * dq[i]
        bend = 0.0
        if epsilon > 0.0:
            if contacts[row, 7] <= margins[0, pair] + NEAREST:
                here = margins[0, pair]
                ahead = margins[1, pair] - here - epsilon * speed
                behind = margins[2, pair] - here + epsilon * speed
                bend = 2.0 * max(ahead, behind) / (epsilon * epsilon)
            else:
                if pair != last:
                    twist[:, :], rate[:, :], last = 0.0, 0.0, pair
                    for column in range(n):  # in Pinocchio's order carriers come first
                        which = carried[pair, places[column]]
                        if which != 0.0:
                            side = 0 if which > 0.0 else 1
                            joint[:] = twists[:, column]
                            carry(twist[side], rate[side], joint, dq[places[column]])
                contact = contacts[row]
                bend = min(_material(contact, twist, rate, 0), _material(contact, twist, rate, 1))
        room = _bound(contacts[row, 7], eta, reserve, return_speed)
        upper_out[row] = 2.0 * eta * speed + eta * room + bend
