"""Which limits of its joints a trajectory exceeds, and how much slower it would not."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.references.trajectories.motion_file import Motion
from hoap3.remote_controller.references.trajectories.trajectory import Trajectory
from hoap3.tools.robots.polynomial_peaks import derivative, peaks, value

STILL = 1e-9  # of a velocity's jump: less is rounding
PER = {"velocity": "/s", "acceleration": "/s²"}  # of a quantity, behind rad or m
DIGITS = 1e4  # what is proposed is rounded up to 1 / it


class Quantity(NamedTuple):
    """What is compared with a limit, once in each segment, (k, m).

    Attributes:
        what: its name.
        values, limits: of each segment and joint.
        times_s: when, since the start [s].
        shares: of the limit that is taken, by which a motion must be slower: > 1 exceeds it.
        slower: whether a slower motion has less of it.
    """

    what: str
    values: FloatArray
    limits: FloatArray
    times_s: FloatArray
    shares: FloatArray
    slower: bool = True


def limits_exceeded(
    path: Trajectory, motion: Motion, robot: RobotDescription, joints: list[int], scaling: float
) -> dict[str, Any]:
    """What is beyond the limits of position, velocity and acceleration, and what would fit.

    Args:
        path: of `motion`, started from where the robot is.
        joints: places of its joints in wire order.
        scaling: of its times.
    """
    lead = float(path.times_s[1])
    approaches = motion.times_s[0] == 0.0
    exceeded: list[dict[str, Any]] = []
    needed, needed_approach, fits = 0.0, 0.0, True
    for each in _quantities(path, robot, joints):
        first = each.shares[:1] if approaches else each.shares[:0]
        rest = each.shares[1:] if approaches else each.shares
        if each.slower:
            needed_approach = max(needed_approach, float(first.max(initial=0.0)))
            needed = max(needed, float(rest.max(initial=0.0)))
        else:
            fits = fits and not (each.shares > 1.0).any()
        exceeded += _worst(each, motion, robot, approaches=approaches)
    return {
        "exceeded": sorted(exceeded, key=lambda found: float(found["time_s"])),
        "fits_with_time_scaling": _up(needed * scaling) if fits else None,
        "approach_s": lead if approaches else 0.0,
        "fits_with_approach_s": _up(needed_approach * lead) if approaches else 0.0,
    }


def _quantities(path: Trajectory, robot: RobotDescription, joints: list[int]) -> Iterator[Quantity]:
    """Extremes of the polynomials; and where the velocity jumps, it does so within a period."""
    k, _, m = path.polynomials.shape
    begins, widths = path.times_s[:-1, None], np.diff(path.times_s)[:, None]
    there = widths > 0.0
    c = np.where(there[:, :, None], path.polynomials, 0.0).transpose(1, 0, 2).reshape(6, k * m)
    widths = np.where(there, widths, 1.0)
    lower, upper = robot.lower[joints], robot.upper[joints]
    if not path.times_s[1]:  # no time to come to the first point
        jump = np.zeros((k, m))
        jump[0] = path.polynomials[1, 0] - robot.initial_position[joints]
        shares = np.where(np.abs(jump) > STILL, 2.0, 0.0)
        yield Quantity("jump of the position", jump, 0.0 * jump, 0.0 * jump, shares)
    (z, low), (z_high, high) = peaks(c)
    low, high = low.reshape(k, m), high.reshape(k, m)
    for at, values, limit, sign in ((z, low, lower, -1.0), (z_high, high, upper, 1.0)):
        over = (sign * (values - limit) > STILL) & there
        times = begins + at.reshape(k, m) * widths
        limits = np.broadcast_to(limit, (k, m))
        yield Quantity("position", values, limits, times, np.where(over, 2.0, 0.0), slower=False)
    rates = ("velocity", robot.velocity), ("acceleration", robot.setpoint_acceleration_max)
    for order, (what, most) in enumerate(rates, 1):
        c = derivative(c)
        (z, low), (z_high, high) = peaks(c)
        downwards = np.abs(low) > np.abs(high)
        values = np.where(downwards, low, high).reshape(k, m) / widths**order
        times = begins + np.where(downwards, z, z_high).reshape(k, m) * widths
        limits = np.broadcast_to(most[joints], (k, m))
        shares = np.asarray((np.abs(values) / limits) ** (1.0 / order), float)
        yield Quantity(what, values, limits, times, shares)
        if order == 1:
            yield _jumps(c, begins, widths, there, robot, joints)


def _jumps(
    c: FloatArray,
    begins: FloatArray,
    widths: FloatArray,
    there: NDArray[np.bool_],
    robot: RobotDescription,
    joints: list[int],
) -> Quantity:
    """Of the velocity where each segment begins and where the last one ends, the larger one."""
    k, m = len(begins), len(joints)
    starts = value(c, np.zeros(k * m)).reshape(k, m) / widths
    ends = value(c, np.ones(k * m)).reshape(k, m) / widths
    before = np.vstack([np.zeros((1, m)), ends[:-1]])
    values, times = starts - before, np.broadcast_to(begins, (k, m)).copy()
    values[~there[:, 0]] = 0.0
    last = np.abs(ends[-1]) > np.abs(values[-1])
    values[-1, last] = -ends[-1, last]
    times[-1, last] = begins[-1, 0] + widths[-1, 0]
    values[np.abs(values) <= STILL] = 0.0
    values /= robot.period_s
    limit = np.broadcast_to(robot.setpoint_acceleration_max[joints], (k, m))
    return Quantity(
        "acceleration in a jump of the velocity", values, limit, times, np.abs(values) / limit
    )


def _worst(
    given: Quantity, motion: Motion, robot: RobotDescription, *, approaches: bool
) -> Iterator[dict[str, Any]]:
    """Of each joint the segment that exceeds the limit most, and how many do."""
    per = next((unit for word, unit in PER.items() if given.what.startswith(word)), "")
    for joint, name in enumerate(motion.names):
        over = given.shares[:, joint] > 1.0
        if not over.any():
            continue
        excess = np.abs(given.values[:, joint] - given.limits[:, joint])
        sizes = given.shares[:, joint] if given.slower else excess
        k = int(np.argmax(np.where(over, sizes, -np.inf)))
        slides = robot.structure.movable[name].kind == "prismatic"
        yield {
            "joint": name,
            "what": given.what,
            "value": float(given.values[k, joint]),
            "limit": float(given.limits[k, joint]),
            "unit": ("m" if slides else "rad") + per,
            "time_s": float(given.times_s[k, joint]),
            "line": int(motion.lines[max(k - 1, 0)]),
            "approach": bool(k == 0 and approaches),
            "segments": int(over.sum()),
        }


def _up(number: float) -> float:
    return math.ceil(number * DIGITS) / DIGITS
