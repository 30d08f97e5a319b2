"""The setpoint filter in the robot's tick: what it holds back, counts, and does in silence."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.robot_bench import Bench, active
from support.small_arm import arm
from support.strong_arms import changed

from hoap3.protocol.messages import Event, State
from hoap3.robot_emulator.filters.position import PositionFilter

# From tick 0 on, each joint takes 1 rad/s in a period, up to 3 rad/s.
T, ACCELERATION = 1e-3, Event.schema.constants["LIMIT_ACCELERATION"]


def velocities(bench: Bench) -> np.ndarray:
    """Of the reference, row k - 1 in the period before tick k."""
    return np.diff([state.reference for state in bench.states()], axis=0) / T


def test_each_period_in_which_some_joint_is_held_back_counts_once():
    bench = active()
    bench.speed[:] = (2.5, 0.0, -2.5)  # it does 1 rad/s, then 2
    bench.run(20)
    assert bench.robot.summary()["interventions"] == 2
    np.testing.assert_allclose(velocities(bench)[:4, 0], [1.0, 2.0, 2.5, 2.5], atol=1e-9)
    np.testing.assert_allclose(velocities(bench)[:4, 2], [-1.0, -2.0, -2.5, -2.5], atol=1e-9)
    clipped = [event for event in bench.events() if event[0] == "CLIPPED"]
    assert clipped == [("CLIPPED", 1, ACCELERATION << 16)]  # joint 0, and the first one only
    first = bench.description.joint_names[0]
    told = {"first": first, "first_tick": 1, "most": first, "most_periods": 2}
    assert bench.robot.summary()["held_back_joints"] == told


def test_the_joint_that_is_held_back_most_often_is_another_than_the_first():
    bench = active()
    assert bench.robot.summary()["held_back_joints"] is None
    bench.speed[:] = (1.5, 0.0, 0.0)
    bench.run(10)
    bench.speed[:] = (1.5, 0.0, 2.9)
    bench.run(10)
    names, told = bench.description.joint_names, bench.robot.summary()["held_back_joints"]
    assert (told["first"], told["most"]) == (names[0], names[2])


def test_what_is_clipped_within_200_ticks_of_a_start_counts_apart():
    bench = active()
    bench.run(150)
    bench.speed[:] = (2.5, 0.0, 0.0)  # it does 1 rad/s, then 2
    bench.run(100)
    bench.speed[:] = 0.0
    bench.run(10)
    summary = bench.robot.summary()
    assert (summary["interventions"], summary["startup_interventions"]) == (4, 2)
    limit = {"limit": "acceleration", "value": 1000.0, "unit": "rad/s²"}
    assert summary["held_back_limit"] == limit


def test_a_range_that_clips_a_setpoint_is_named_by_its_nearer_end():
    bench = active()
    assert bench.robot.summary()["held_back_limit"] is None
    bench.speed[:] = (0.0, -0.9, 0.0)
    bench.run(5000)
    found = bench.robot.summary()["held_back_limit"]
    lower = float(bench.description.lower[1])
    assert found == {"limit": "position", "value": lower, "unit": "rad"}
    assert bench.robot.summary()["startup_interventions"] == 0


def test_a_joint_is_named_for_every_intervention_of_a_stop_too():
    bench = active()
    bench.speed[:] = (1.5, 0.0, 0.0)
    bench.run(10)
    before = bench.robot.summary()
    bench.robot._setpoint_filter._filter = lambda *_: 0  # at a limit in every period from now on
    bench.robot.stop("REASON_COMMAND")
    bench.run(20)
    after = bench.robot.summary()
    more = after["interventions"] - before["interventions"]
    assert more > 0
    assert after["held_back_joints"]["most_periods"] == 1 + more
    assert before["held_back_joints"]["most_periods"] == before["interventions"] == 1


@pytest.mark.parametrize("policy", ["hold", "extrapolate"])
@pytest.mark.parametrize("misses", [1, 20])
def test_in_silence_it_is_at_rest_as_soon_as_it_can_be_told_and_can_brake(policy, misses):
    v, brake = 2.5, 40.0
    bench = active(
        fate=lambda tick, answer: [(1, answer)] if tick < 50 else [],
        loss_policy=policy,
        misses_to_stop=misses,
    )
    bench.speed[0] = v
    bench.run(200)
    assert bench.states()[-1].mode == State.STOPPED
    found = velocities(bench)[:, 0]
    assert found[49] == pytest.approx(v)  # the last answer, applied at tick 50
    longest = misses + math.ceil(v / (brake * T))
    assert np.all(found[48 + longest :] == 0.0)
    if policy == "extrapolate":
        assert found[47 + longest] > 0.0
        assert np.abs(np.diff(found[50:])).max() <= brake * T + 1e-9
    assert np.abs(np.diff(found)).max() <= 1000.0 * T + 1e-9


def test_a_brake_stronger_than_what_setpoints_may_is_used_as_far_as_they_may():
    robot = changed(arm(), brake_acceleration=400.0, setpoint_acceleration_max=100.0)
    reference = PositionFilter(robot, T)
    reference.reset(robot.initial_position)
    for tick in range(10):
        reference.follow(reference.value + (tick + 1) * np.array([0.1, -0.05, 0.0]) * T, tick)
    assert reference.interventions == 0
    rates = [reference.rate.copy()]
    reference.begin_stop()
    while not reference.brake():
        rates.append(reference.rate.copy())
    rates.append(reference.rate.copy())
    assert reference.interventions == 0
    assert 10 <= len(rates) - 1 <= 11
    assert np.abs(np.diff(rates, axis=0)).max() <= 100.0 * T
    np.testing.assert_allclose(np.array(rates)[:, 1], np.array(rates)[:, 0] / -2, atol=1e-12)
    np.testing.assert_array_equal(rates[-1], 0.0)
