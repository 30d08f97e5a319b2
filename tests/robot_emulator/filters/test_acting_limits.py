"""Which limit held a joint back."""

from __future__ import annotations

import numpy as np
import pytest
from support.small_arm import arm
from support.strong_arms import changed

from hoap3.protocol.messages import Event
from hoap3.robot_emulator.filters.acceleration import AccelerationFilter, FreeBaseFilter
from hoap3.robot_emulator.filters.jerk import JerkFilter
from hoap3.robot_emulator.filters.position import PositionFilter

EVENTS = Event.schema.constants
LIMITS = {value: name for name, value in EVENTS.items() if name.startswith("LIMIT_")}
T, A, SPEED, RANGE = 1e-3, 20.0, 1.5, 2.0
TICKS = np.arange(4000) * T


def robot(jerk: float = np.inf):
    limits = {"velocity": SPEED, "setpoint_acceleration_max": A, "setpoint_jerk_max": jerk}
    return changed(arm(), **limits)


def first_held(kind, description, offsets, joint=1):
    """The first joint that is held back, and by which limit."""
    guard, start = kind(description, T), np.zeros(description.n)
    guard.reset(start)
    for tick, offset in enumerate(offsets):
        setpoint = start.copy()
        setpoint[joint] = offset
        held = guard.follow(setpoint, tick)
        if held >= 0:
            return held, LIMITS[guard.limit_of(held)]
    return None


SMOOTH = 0.1 * A * TICKS**2 / 2
SLOW = np.where(TICKS < 0.5, TICKS**2, TICKS - 0.25)  # 2 rad/s², then 1 rad/s
MOTIONS = {
    "jump": ([0.0, 0.0, 0.3], "LIMIT_ACCELERATION"),
    "jump of the speed": ([0.0, 3 * A * T**2], "LIMIT_ACCELERATION"),
    "out of range": ([0.0, RANGE + 0.5], "LIMIT_POSITION"),
    "into the wall": (SLOW, "LIMIT_POSITION"),
    "ever faster": (SMOOTH, "LIMIT_SPEED"),
}


@pytest.mark.parametrize(("beyond", "held"), [(1e-14, False), (1e-11, True)])
def test_a_setpoint_that_is_missed_by_rounding_is_followed(beyond, held):
    found = first_held(PositionFilter, robot(), [0.0, A * T**2 + beyond])
    assert (found is not None) == held


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("name", MOTIONS)
def test_the_limit_of_positions_that_acts_is_named(name, sign):
    offsets, limit = MOTIONS[name]
    offsets = sign * np.asarray(offsets)
    assert first_held(PositionFilter, robot(), offsets) == (1, limit)


J = A / (20 * T)
JERKS = {
    "jump": ([0.0, 0.0, 0.3], "LIMIT_JERK"),
    "out of range": ([0.0, RANGE + 0.5], "LIMIT_POSITION"),
    "faster than the speed": (J / 100 * TICKS**3 / 6, "LIMIT_SPEED"),
    "jump of the acceleration": (0.5 * A * TICKS**2 / 2, "LIMIT_JERK"),
}


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("name", JERKS)
def test_the_limit_of_jerk_is_told_from_the_others(name, sign):
    offsets, limit = JERKS[name]
    offsets = sign * np.asarray(offsets)
    assert first_held(JerkFilter, robot(J), offsets) == (1, limit)


class Body:
    """A plant that is where it is put."""

    def __init__(self, q: float, dq: float) -> None:
        self.q, self.dq = np.full(3, q), np.full(3, dq)


@pytest.mark.parametrize(
    ("q", "dq", "limit"),
    [
        (0.0, 0.0, "LIMIT_ACCELERATION"),
        (0.0, SPEED - 1e-4, "LIMIT_SPEED"),
        (RANGE - 1e-5, 0.0, "LIMIT_POSITION"),
    ],
)
def test_the_limit_of_accelerations_that_acts_is_named(q, dq, limit):
    guard = AccelerationFilter(robot(), Body(0.0, 0.0), 5)
    guard._plant.q[:], guard._plant.dq[:] = q, dq
    assert guard.follow(np.array([0.0, 1e6, 0.0]), 0) == (1 if dq == 0.0 else 0) or dq > 0.0
    assert LIMITS[guard.limit_of(1)] == limit


def test_torques_beyond_the_effort_are_cut_by_the_limit_of_torque():
    guard = FreeBaseFilter(robot(), Body(0.0, 0.0), 5, None)
    assert guard.follow(np.array([0.0, 11.0, 0.0]), 0) == 1
    assert LIMITS[guard.limit_of(1)] == "LIMIT_TORQUE"
