"""Limits that a robot could not keep under accelerations or torques are refused, by name."""

from __future__ import annotations

import pytest
from support.arm3 import YAML, write
from support.strong_arms import changed, small

from hoap3.protocol.errors import DescriptionError
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.plant_factory import build_body
from hoap3.tools.services.settings import checked

FAST = """command_kinds: [position, torque]
brake_acceleration: 20000.0
setpoint_acceleration_max: 20000.0
"""


@pytest.mark.parametrize("kind", ["acceleration", "torque"])
def test_limits_against_condition_11_name_robot_joint_and_remedy(kind):
    most = {"brake_acceleration": 20_000.0, "setpoint_acceleration_max": 20_000.0}
    robot = changed(small(kind), **most)
    with pytest.raises(DescriptionError) as refused:
        build_body(robot, EmulatorConfig())
    for word in (robot.name, robot.joint_names[0], "(11)", kind, "brake_acceleration"):
        assert word in str(refused.value)


def test_config_check_refuses_what_a_start_would(tmp_path):
    path = str(write(tmp_path, YAML + FAST))
    checked(path, ["command=position"])
    with pytest.raises(DescriptionError, match="torque"):
        checked(path, ["command=torque"])
