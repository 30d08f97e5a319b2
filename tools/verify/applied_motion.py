"""Whether the reference that a robot applied kept the robot's limits between ticks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import State
from hoap3.tools.verify.claims import RELATIVE, Claims

Rows = NDArray[np.void]

ROUNDINGS = 8  # ulp of a position, per difference


def check_motion(states: Rows, robot: RobotDescription, claims: Claims) -> None:
    """Position, speed and acceleration of the applied reference, by its differences.

    Each State is one period of the body after the last: it does not move in skipped periods.

    Args:
        states: of one session, in the order of their ticks, without a gap.
        robot: whose limits count.
        claims: takes what was compared.
    """
    if robot.command_kinds[0] != "position":
        claims.unverified("applied motion", len(states), "the robot takes no positions")
        return
    s, tick, T = states["reference"], states["tick"], robot.period_s
    ulp = np.spacing(np.abs(s).max(0))
    start = s[0]  # a joint that starts beyond its range may come back, and go no further
    most, least = np.maximum(robot.upper, start), np.minimum(robot.lower, start)
    claims.at_most("applied position, upper", tick, s, most, ulp)
    claims.at_most("applied position, lower", tick, -s, -least, ulp)
    v = np.diff(s, axis=0) / T
    fastest = np.broadcast_to(robot.velocity, v.shape)
    claims.at_most(
        "applied speed", tick[1:], np.abs(v), fastest, RELATIVE * fastest + ROUNDINGS * ulp / T
    )
    change = np.abs(np.diff(v, axis=0, prepend=np.zeros((1, robot.n)))) / T
    greatest = np.broadcast_to(robot.setpoint_acceleration_max, change.shape)
    off = RELATIVE * greatest + ROUNDINGS * ulp / T**2
    claims.at_most("applied acceleration", tick[1:], change, greatest, off)
    resting = np.isin(states["mode"], (State.IDLE, State.STOPPED))
    at_rest = resting[1:] & resting[:-1]
    claims.equal("reference at rest", tick[1:][at_rest], v[at_rest], 0.0 * v[at_rest], 0.0)
