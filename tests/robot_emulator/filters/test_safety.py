"""Whatever is asked for, the applied reference stays inside the limits, and stops as planned."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from support.small_arm import arm
from support.strong_arms import changed

from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.filters.position import PositionFilter

DT = 1e-3
ULP = np.finfo(float).eps
# One joint whose limits are no round numbers, one that is slow, one whose range begins at zero.
# No acceleration is too much here: tests/limits has that.
ROBOT: RobotDescription = arm(
    joints=tuple(
        joint.model_copy(update={"setpoint_acceleration_max": 1e6, **changes})
        for joint, changes in zip(
            arm().joints,
            (
                {"lower": -np.pi / 3, "upper": 0.1 + 0.2, "velocity": 4.76},
                {"velocity": 0.01, "brake_acceleration": 7.0},
                {"lower": 0.0, "upper": 1e-3 / 3},
            ),
            strict=True,
        )
    ),
    postures={"start": (0.1, -0.2, 1e-4)},
)
LOWER, UPPER, STEP = ROBOT.lower, ROBOT.upper, ROBOT.velocity * DT
START = ROBOT.initial_position

anything = st.floats(allow_nan=False, allow_infinity=False)
nearby = st.floats(-0.01, 0.01)
setpoints = st.one_of(
    st.lists(anything, min_size=3, max_size=3).map(np.array),
    st.lists(nearby, min_size=3, max_size=3).map(lambda away: START + np.array(away)),
    st.sampled_from([LOWER, UPPER, START, np.nextafter(UPPER, np.inf), np.zeros(3)]),
)
misses = st.sampled_from(["hold", "extrapolate"])
commands = st.lists(st.one_of(setpoints, misses), min_size=1, max_size=30)


def offset(*joints: float) -> np.ndarray:
    return np.array(joints)


def at_start(description: RobotDescription = ROBOT) -> PositionFilter:
    reference = PositionFilter(description, DT)
    reference.reset(description.initial_position)
    return reference


def obey(reference: PositionFilter, command: np.ndarray | str, tick: int) -> int:
    if isinstance(command, str):
        return getattr(reference, command)()
    return reference.follow(command, tick)


@given(commands)
def test_the_rate_is_that_of_the_last_period(asked):
    reference = at_start()
    for tick, command in enumerate(asked):
        before = reference.value.copy()
        obey(reference, command, tick)
        rounding = ULP * np.maximum(np.abs(before), np.abs(reference.value)) / DT
        error = np.abs(reference.rate - (reference.value - before) / DT)
        assert (error <= 2 * rounding + ULP * np.abs(reference.rate)).all()


@given(commands)
@example([np.full(3, 1.7e308), np.full(3, -1.7e308), "extrapolate", "extrapolate"])
def test_nothing_overflows(asked):
    with np.errstate(all="raise", under="ignore"):
        reference = at_start()
        for tick, command in enumerate(asked):
            obey(reference, command, tick)
        reference.begin_stop()
        while not reference.brake():
            pass


def test_a_robot_that_starts_outside_its_usable_range_is_not_pulled_in():
    outside = arm(
        postures={"start": (2.05, -2.1, 0.0)}
    )  # the usable range ends at 2, the stops at 2.1
    reference = at_start(outside)
    assert reference.hold() == -1
    np.testing.assert_array_equal(reference.value, outside.initial_position)
    asked = np.array([2.06, -2.2, 0.0])
    assert reference.follow(asked, 0) == 0  # further out it may not
    np.testing.assert_array_equal(reference.value, outside.initial_position)
    inwards = np.array([2.049, -2.099, 0.001])
    assert reference.follow(inwards, 1) == -1
    np.testing.assert_array_equal(reference.value, inwards)
    assert reference.follow(asked, 2) == 0  # and what has come in does not go out again
    assert reference.follow(asked, 3) == 0
    assert 2.0 < reference.value[0] <= 2.049
    for tick in range(4, 200):
        reference.follow(np.zeros(3), tick)
    for tick in range(200, 1000):
        reference.follow(asked, tick)
    assert reference.value[0] == 2.0


class TestLossOfSetpoints:
    def followed(self, *asked: tuple[int, list[float]]) -> PositionFilter:
        reference = at_start()
        for tick, away in asked:
            reference.follow(START + offset(*away), tick)
        return reference

    def test_hold_stays_at_the_last_one(self):
        reference = self.followed((0, [1e-3, 0, 0]), (1, [2e-3, 0, 0]))
        for _ in range(5):
            assert reference.hold() == -1
        np.testing.assert_array_equal(reference.value, START + offset(2e-3, 0, 0))

    def test_extrapolation_goes_on_as_the_last_two_did(self):
        reference = self.followed((0, [1e-3, 0, 1e-6]), (1, [2e-3, 1e-6, 0]))
        for lost in range(1, 6):
            assert reference.extrapolate() == -1
            expected = START + offset(2e-3 + lost * 1e-3, 1e-6 + lost * 1e-6, -lost * 1e-6)
            np.testing.assert_allclose(reference.value, expected, rtol=0, atol=1e-15)

    def test_extrapolation_counts_the_ticks_between_them(self):
        reference = self.followed((0, [1e-3, 0, 0]), (4, [3e-3, 0, 0]))
        reference.extrapolate()
        np.testing.assert_allclose(
            reference.value, START + offset(3.5e-3, 0, 0), rtol=0, atol=1e-15
        )

    def test_one_setpoint_gives_no_direction(self):
        reference = self.followed((3, [1e-3, 0, 0]))
        reference.extrapolate()
        np.testing.assert_array_equal(reference.value, START + offset(1e-3, 0, 0))

    def test_nothing_is_extrapolated_from_before_a_new_beginning(self):
        reference = self.followed((0, [1e-3, 0, 0]), (1, [2e-3, 0, 0]))
        reference.forget()
        here = reference.value.copy()
        reference.extrapolate()
        np.testing.assert_array_equal(reference.value, here)
        reference.follow(here, 7)
        reference.extrapolate()
        np.testing.assert_array_equal(reference.value, here)

    def test_what_was_out_of_reach_is_not_extrapolated(self):
        reference = self.followed((0, [0, 0, 0]), (1, [0, 0, 1.0]))
        for _ in range(10):
            reference.extrapolate()
        assert reference.value[2] == UPPER[2]
        reference.follow(START, 12)
        np.testing.assert_array_equal(reference.value, START)


def moving(speed: np.ndarray) -> PositionFilter:
    """A reference of the plain arm in full motion [rad/s], far from its limits."""
    reference = at_start(arm())
    value = reference.value.copy()
    for tick in range(20):
        value = value + speed * DT
        reference.follow(value, tick)
    return reference


speeds = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3).map(np.array)


class TestStop:
    def stopped(self, speed: np.ndarray) -> np.ndarray:
        """Velocities from the last period before the stop to the last one of it, (ticks, n)."""
        reference = moving(speed)
        rates = [reference.rate.copy()]
        reference.begin_stop()
        done = False
        while not done:
            done = reference.brake()
            rates.append(reference.rate.copy())
        return np.array(rates)

    @given(speeds)
    def test_it_brakes_within_the_limits_and_ends_at_rest_exactly(self, speed):
        rates = self.stopped(speed)
        rounding = 2 * 2.1 * ULP / DT  # of differences of positions, in rad/s
        braking = np.abs(np.diff(rates, axis=0)) / DT
        assert (braking <= 40.0 * (1 + 1e-9) + 2 * rounding / DT).all()
        np.testing.assert_array_equal(rates[-1], 0.0)

    @given(speeds)
    def test_all_joints_come_to_rest_together_in_a_straight_line(self, speed):
        rates = self.stopped(speed)
        periods = len(rates) - 1
        expected = rates[0] * (1 - np.arange(periods + 1) / periods)[:, None]
        np.testing.assert_allclose(rates, expected, rtol=0, atol=4 * 2.1 * ULP / DT)

    @given(speeds)
    def test_it_takes_no_longer_than_the_fastest_joint_needs(self, speed):
        rates = self.stopped(speed)
        needed = np.abs(rates[0]).max() / (40.0 * DT)
        assert len(rates) - 1 <= max(1, np.ceil(needed + 1e-6))

    def test_the_joint_that_brakes_worst_sets_the_time(self):
        weak = changed(arm(), brake_acceleration=(40.0, 5.0, 40.0))
        reference = at_start(weak)
        reference.follow(weak.initial_position + offset(1e-3, 1e-3, 0.0), 0)  # 1 rad/s
        reference.begin_stop()
        ticks = 1
        while not reference.brake():
            ticks += 1
        assert ticks == 200

    def test_a_stop_at_rest_is_over_at_once(self):
        reference = at_start()
        reference.begin_stop()
        assert reference.brake()
        np.testing.assert_array_equal(reference.value, START)

    def test_a_stop_ends_at_a_limit_that_is_nearer(self):
        reference = at_start()
        reference.follow(START + offset(4.76e-3, 0, 0), 0)
        while reference.value[0] < UPPER[0] - 0.01:
            reference.follow(reference.value + offset(4.7e-3, 0, 0), 1)
        reference.begin_stop()
        while not reference.brake():
            assert reference.value[0] <= UPPER[0]
        assert reference.value[0] == UPPER[0]
