"""A robot of torques that can just hold itself comes to rest in a stop, and does not fall in it."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.filters.acceleration import REST
from hoap3.robot_emulator.plant_factory import build_body
from hoap3.robot_emulator.robots import load

Q = [-0.3087, -0.475, 0.7691, 0.8438, -0.7077, 1.2858, 0.2399]  # s1 needs 48.5 of its 50 N m
DQ = [-0.0246, 0.0277, 0.0218, -0.0396, -0.0257, 0.0146, 0.0031]


@pytest.mark.parametrize("faster", [1.0, -1.0, 5.0])
def test_it_brakes_as_fast_as_all_joints_together_can(faster):
    robot = load("baxter_right_arm").model_copy(update={"command_kinds": ("torque",)})
    body, setpoint_filter = build_body(robot, EmulatorConfig(robot=robot.name))
    body.reset(np.array(Q))
    setpoint_filter.reset(np.array(Q))
    body.dq[:] = faster * np.array(DQ)
    weight = np.zeros(robot.n)
    Dynamics(robot).gravity(body.q, weight)
    assert (np.abs(weight) < robot.effort).all()
    setpoint_filter.begin_stop()
    for _ in range(150):
        if setpoint_filter.brake():
            break
        body.step(setpoint_filter.value, robot.period_s)
    assert np.abs(body.dq).max() <= REST
    assert np.abs(body.q - Q).max() < 0.01
    assert setpoint_filter.torque_limited == 0
    assert (np.abs(body.tau) <= robot.effort).all()
