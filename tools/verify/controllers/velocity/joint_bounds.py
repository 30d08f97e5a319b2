"""Which joint velocities the controllers of several tasks allow in each cycle.

A joint's velocity may change by A·T in a period, may not exceed the greatest speed ω, and must let
the joint come to rest before the end of its range, in steps of A·T.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.problems.oracles.constraints.joints_oracle import stopping_speed
from hoap3.tools.logs.disk_rows import RowsAt
from hoap3.tools.verify.controller_log import ControllerRun

Array = NDArray[np.float64]
Bounds = tuple[Array, Array]

INSIDE = 1.0 - 1e-9  # of the robot's greatest acceleration: it judges by rounded positions
UNIT = 2.0**-52  # of the last place, relative
RESERVES = 8.0  # units that each step of braking may round by
MARGIN_RAD = 1e-9  # taken off both ends of the range


def bounds_of(run: ControllerRun, given: Mapping[str, Any]) -> Bounds:
    """Least and greatest velocity of each joint for each answer, both (N, n) [rad/s or m/s].

    Args:
        run: whose reference decides, and how it moved since the State before.
        given: `bounds` of the config.
    """
    T, limits = run.description.period_s, limits_of(run.description, given)
    reference = run.answered_states["reference"]
    return velocity_bounds(reference, reference_rates(run), limits, T)


def limits_of(robot: RobotDescription, given: Mapping[str, Any]) -> Array:
    """Ends of the range, greatest speed and acceleration, (4, n), none beyond the robot's."""
    aside = float(given.get("margin_rad", MARGIN_RAD))
    speed, acceleration = given.get("speed_rad_s"), given.get("acceleration_rad_s2")
    return np.array(
        [
            robot.lower + aside,
            robot.upper - aside,
            np.minimum(robot.velocity, np.inf if speed is None else float(speed)),
            np.minimum(
                INSIDE * robot.setpoint_acceleration_max,
                robot.brake_acceleration if acceleration is None else float(acceleration),
            ),
        ]
    )


def reference_rates(run: ControllerRun) -> Array:
    """How the reference of each answer's State moved since the State before, (N, n) [rad/s].

    At the first State after a reset it is what the robot measured.
    """
    states, T = run.states, run.description.period_s
    finite = RowsAt.of(states).finite("q", "reference")
    places = np.arange(len(states))
    last = np.maximum.accumulate(np.where(finite, places, -1))
    before = np.append(-1, last[:-1])[run.answered]
    resets = np.array([-1, *run.resets])
    begun = resets[np.searchsorted(resets, run.answered, "right") - 1]
    periods = (states["tick"] - states["skipped"]).astype(np.int64)
    apart = periods[run.answered] - periods[before]
    known = (before >= np.maximum(begun, 0)) & (apart > 0)
    moved = states["reference"][run.answered] - states["reference"][before]
    rates = moved / (np.where(known, apart, 1) * T)[:, None]
    measured = np.nan_to_num(states["dq"][run.answered], posinf=0.0, neginf=0.0)
    return np.asarray(np.where(known[:, None], rates, measured))


def velocity_bounds(q: Array, v: Array, limits: Array, T: float) -> Bounds:
    """Least and greatest next velocity at positions and velocities, all (N, n)."""
    lower, upper, speed, A = limits
    most = np.clip(v + A * T, -speed, speed)
    least = np.clip(v - A * T, -speed, speed)
    braked = _towards(most, upper - q, upper, limits, T)
    most = np.where(most > 0.0, braked, most)
    braked = -_towards(-least, q - lower, lower, limits, T)
    least = np.where(least < 0.0, braked, least)
    crossed = least > most  # too fast to stop in time as gently as that
    both = np.where(v > 0.0, most, least)
    return np.where(crossed, both, least), np.where(crossed, both, most)


def _towards(wanted: Array, room: Array, wall: Array, limits: Array, T: float) -> Array:
    """As much of a velocity towards a wall, `room` away, as lets a joint stop before it."""
    _, _, speed, A = limits
    steps = speed / (A * T) + 2.0
    far = np.minimum(0.5 * steps * speed * T, np.maximum(room, 0.0))
    solid = np.isfinite(wall)
    reserve = RESERVES * UNIT * steps * (np.where(solid, np.abs(wall), 0.0) + far)
    left = room - np.where(solid, reserve, 0.0)
    free = 0.5 * wanted * (wanted / A + T) + A * T * T / 8.0 <= left
    last = np.minimum(np.maximum(room, 0.0) / T, A * T)
    braking = np.maximum(last, stopping_speed(np.where(solid, left, 0.0), A, T))
    return np.where(free, wanted, np.minimum(wanted, braking))
