"""Compiled safety filter of a robot with a limit of jerk: any stream becomes a motion within all.

At each tick a joint has an interval of accelerations (`jerk_interval_kernels`), which is never
empty, whatever the setpoint asks for; one of them is taken. Joints are worked out in blocks
(`jerk_block_kernels`).
"""

from __future__ import annotations

import math

from hoap3.protocol.limits.jerk_limits_kernels import brake_rise
from hoap3.protocol.limits.jerk_takeover_kernels import Motion, of_joint
from hoap3.protocol.limits.setpoint_limits_kernels import (
    SAME,
    JointLimits,
    stopping_speed,
    within,
)
from hoap3.protocol.runtime.numba_jit import Matrix, Vector, kernel
from hoap3.robot_emulator.filters.jerk_approach_kernels import JOINTS
from hoap3.robot_emulator.filters.jerk_block_kernels import (
    BEFORE,
    Q,
    V,
    find_motions,
    hand_out,
    take_in,
)
from hoap3.robot_emulator.filters.jerk_interval_kernels import moved, within_all
from hoap3.robot_emulator.filters.position_kernels import follow_one


@kernel()
def filter_jerk(
    setpoint: Vector,
    history: Matrix,
    limits: Matrix,
    T: float,
    motion: Matrix,
    work: Vector,
) -> int:
    """Move joints to setpoints, (n,), or as near and as fast as the limits allow.

    What can be taken over is so bit by bit. A joint without a limit of jerk moves as of
    `filter_setpoint`.

    Args:
        setpoint: what is asked for [rad or m]. Beyond a limit it is the limit that counts, and for
            NaN the place where a joint is.
        history: (3, n) what was so one, two and three periods ago; the setpoint is added.
        limits: (5, n) least and greatest position, greatest speed, acceleration and jerk; inf: no
            limit of jerk.
        T: period [s].
        motion: (3, n) applied reference, and its velocity and acceleration over the last period,
            changed in place.
        work: (WORK,) room for `jerk_block_kernels`; nothing is kept in it.

    Returns:
        The number of the first joint that was held back, or -1.
    """
    held = -1
    for first in range(0, setpoint.size, JOINTS):
        count = min(JOINTS, setpoint.size - first)
        take_in(work, first, count, setpoint, history, limits, motion)
        find_motions(work, count, T)
        hand_out(work, first, count, history, motion)
        for i in range(first, first + count):
            if not limits[4, i] < math.inf:
                place = i - first
                q, v, before = work[Q + place], work[V + place], work[BEFORE + place]
                plain = JointLimits(limits[0, i], limits[1, i], limits[2, i], limits[3, i])
                q, w = follow_one(setpoint[i], before, q, v, plain, T)
                motion[0, i], motion[1, i], motion[2, i] = q, w, (w - v) / T
            if held < 0 and not abs(motion[0, i] - setpoint[i]) <= SAME:
                held = i
    return held


@kernel()
def steer(
    wanted: Vector,
    limits: Matrix,
    T: float,
    motion: Matrix,
) -> int:
    """Go on with the velocities wanted, (n,), as far as the limits allow; see `filter_jerk`.

    A joint that cannot do so comes to rest as fast as it can.

    Returns:
        The number of the first joint that was held back, or -1.
    """
    held = -1
    for i in range(wanted.size):
        own, at = of_joint(limits, i, T), Motion(motion[0, i], motion[1, i], motion[2, i])
        a = (wanted[i] - at.v) / T
        if within_all(a, at, own) == a:
            at = Motion(within(at.q + wanted[i] * T, own.lower, own.upper), wanted[i], a)
        else:
            rest = -math.copysign(stopping_speed(abs(at.v), own.J, T), at.v)
            at = moved(within_all(rest, at, own), at, own)
            if held < 0:
                held = i
        motion[0, i], motion[1, i], motion[2, i] = at
    return held


@kernel()
def brake_ends(
    limits: Matrix,
    T: float,
    motion: Matrix,
    lowest: Vector,
    highest: Vector,
) -> None:
    """Where joints get at least, whatever they do: least and greatest places, (n,) each."""
    for i in range(lowest.size):
        own, q = of_joint(limits, i, T), motion[0, i]
        u, x = motion[1, i] * own.velocity, motion[2, i] * own.acceleration
        highest[i] = q + brake_rise(u, x, own.N)[0] / own.place
        lowest[i] = q - brake_rise(-u, -x, own.N)[0] / own.place
