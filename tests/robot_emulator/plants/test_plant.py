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


def test_a_reset_ends_all_motion():
    for settings in ({}, {"servo": "lag"}, {"encoder": "counts"}):
        plant = servo(**settings)
        plant.step(START + 0.1, DT)
        plant.reset(START)
        np.testing.assert_array_equal(plant.dq, 0.0)
        plant.step(START, DT)
        np.testing.assert_array_equal(plant.dq, 0.0)


@given(st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3).map(np.array))
def test_counts_end_where_int16_does(command):
    plant = servo(encoder="counts")
    plant.step(command, DT)
    counts = np.rint(plant.q * SCALES)
    np.testing.assert_array_equal(counts, np.clip(np.rint(command * SCALES), -32768, 32767))


def test_counts_need_a_scale_for_every_joint():
    joints = arm().joints
    without = arm(
        joints=(joints[0].model_copy(update={"encoder_counts_per_rad": None}), *joints[1:])
    )
    with pytest.raises(DescriptionError, match="encoder_counts_per_rad"):
        PositionServo(without, PlantSettings(encoder="counts"))
    PositionServo(without, PlantSettings())
