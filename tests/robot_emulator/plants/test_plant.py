"""The robot's body: servos that follow at once or with a lag, encoders that are exact or count."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.small_arm import arm

from hoap3.protocol.errors import DescriptionError
from hoap3.robot_emulator.config import PlantSettings
from hoap3.robot_emulator.plants.position_servo import PositionServo
from hoap3.robot_emulator.robots import load

DT = 1e-3
START = np.array([0.1, -0.2, 0.3])
SCALES = np.array([10000.0, -10000.0, 10000.0])  # of the small arm, counts/rad
positions = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)


def servo(**settings: object) -> PositionServo:
    plant = PositionServo(arm(), PlantSettings(**settings))
    plant.reset(START)
    return plant


@given(st.lists(positions, min_size=1, max_size=10))
def test_an_ideal_servo_is_where_it_is_told_bit_by_bit(commands):
    plant, before = servo(), START
    for command in commands:
        plant.step(command, DT)
        np.testing.assert_array_equal(plant.q, command)
        np.testing.assert_array_equal(plant.dq, (command - before) / DT)
        before = command


@pytest.mark.parametrize("settings", [{}, {"servo": "lag"}, {"encoder": "counts"}])
def test_it_starts_at_rest_and_keeps_no_hold_of_what_it_is_given(settings):
    given_ = START.copy()
    plant = PositionServo(arm(), PlantSettings(**settings))
    plant.reset(given_)
    np.testing.assert_array_equal(plant.dq, 0.0)
    given_[:] = 9.0
    np.testing.assert_allclose(plant.q, START, rtol=0, atol=1e-15)
    command = np.ones(3)
    plant.step(command, DT)
    measured = plant.q.copy()
    command[:] = 9.0
    np.testing.assert_array_equal(plant.q, measured)
    np.testing.assert_array_equal(plant.tau, 0.0)


@pytest.mark.parametrize("time_constant_ms", [0.5, 20.0, 300.0])
@pytest.mark.parametrize("dt", [1e-3, 5e-3])
def test_a_step_is_answered_by_the_exponential(time_constant_ms, dt):
    """q(t) = c + (q₀ − c)·exp(−t/τ), exactly at the ticks, however long they are."""
    plant = servo(servo="lag", time_constant_ms=time_constant_ms)
    command = np.array([1.0, -1.5, 0.0])
    for tick in range(1, 200):
        plant.step(command, dt)
        left = np.exp(-tick * dt / (time_constant_ms * 1e-3))
        expected = command + (START - command) * left
        np.testing.assert_allclose(plant.q, expected, rtol=0, atol=1e-13)


def test_a_ramp_is_followed_at_a_constant_distance():
    """In steps of r·T the lag behind is r·T·e/(1 − e), e = exp(−T/τ); about r·τ."""
    plant = servo(servo="lag", time_constant_ms=20.0)
    command, step = START.copy(), np.array([1e-3, -2e-3, 5e-4])
    for _ in range(1000):
        command += step
        plant.step(command, DT)
    left = np.exp(-1.0 / 20.0)
    np.testing.assert_allclose(command - plant.q, step * left / (1 - left), rtol=1e-9)
    np.testing.assert_allclose(plant.dq, step / DT, rtol=1e-9)


@given(st.lists(positions, min_size=2, max_size=10))
def test_velocity_is_what_was_measured_over_the_last_period(commands):
    """The backward difference of positions as measured: of counts where they are counted."""
    for settings in ({}, {"servo": "lag"}, {"encoder": "counts"}):
        plant = servo(**settings)
        for command in commands:
            before = plant.q.copy()
            plant.step(command, DT)
            np.testing.assert_array_equal(plant.dq, (plant.q - before) / DT)


def test_velocity_knows_how_long_a_period_was():
    plant = servo()
    plant.step(START + 0.01, 5e-3)
    np.testing.assert_allclose(plant.dq, 2.0, rtol=1e-12)


def test_a_reset_ends_all_motion():
    for settings in ({}, {"servo": "lag"}, {"encoder": "counts"}):
        plant = servo(**settings)
        plant.step(START + 0.1, DT)
        plant.reset(START)
        np.testing.assert_array_equal(plant.dq, 0.0)
        plant.step(START, DT)
        np.testing.assert_array_equal(plant.dq, 0.0)


@given(positions)
def test_counts_are_the_nearest(command):
    plant = servo(encoder="counts")
    plant.step(command, DT)
    counts = plant.q * SCALES
    np.testing.assert_allclose(counts, np.rint(counts), rtol=0, atol=1e-9)
    assert (np.abs(plant.q - command) <= 0.5 / np.abs(SCALES) * (1 + 1e-9)).all()


@given(st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3).map(np.array))
def test_counts_end_where_int16_does(command):
    plant = servo(encoder="counts")
    plant.step(command, DT)
    counts = np.rint(plant.q * SCALES)
    np.testing.assert_array_equal(counts, np.clip(np.rint(command * SCALES), -32768, 32767))


def test_a_joint_that_counts_backwards_saturates_at_the_other_end():
    plant = servo(encoder="counts")
    plant.step(np.array([4.0, 4.0, -4.0]), DT)
    np.testing.assert_allclose(plant.q, [3.2767, 3.2768, -3.2768], rtol=1e-15)


def test_only_the_measurement_is_rounded_not_the_place():
    """A motion of a tenth of a count a tick shows: ten ticks make a count."""
    plant = servo(encoder="counts")
    command = np.zeros(3)
    seen = []
    for _ in range(100):
        command += 1e-5
        plant.step(command, DT)
        seen.append(plant.q[0])
    assert seen[-1] == pytest.approx(1e-3, abs=1e-12)
    assert len(set(seen)) == 11


def test_counts_and_lag_together():
    plant, smooth = servo(servo="lag", encoder="counts"), servo(servo="lag")
    command = np.array([1.0, -1.5, 0.0])
    for _ in range(50):
        plant.step(command, DT)
        smooth.step(command, DT)
        assert np.abs(plant.q - smooth.q).max() <= 0.5e-4 * (1 + 1e-9)


def test_hoap3_counts_209_a_degree():
    description = load("hoap3")
    plant = PositionServo(description, PlantSettings(encoder="counts"))
    plant.reset(np.radians(np.full(21, 10.002)))
    np.testing.assert_allclose(np.degrees(plant.q), 2090 / 209, rtol=1e-14)


def test_counts_need_a_scale_for_every_joint():
    joints = arm().joints
    without = arm(
        joints=(joints[0].model_copy(update={"encoder_counts_per_rad": None}), *joints[1:])
    )
    with pytest.raises(DescriptionError, match="encoder_counts_per_rad"):
        PositionServo(without, PlantSettings(encoder="counts"))
    PositionServo(without, PlantSettings())
