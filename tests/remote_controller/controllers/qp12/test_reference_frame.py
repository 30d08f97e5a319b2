"""What moves is `point`, the frame that it is seen from `reference_frame`; one alone is refused."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.config import build
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.service import describe
from hoap3.tools.services.configs import load_controller_config, load_emulator_config

TARGET = [-0.5, -0.15, 0.35]
LAWS = ("qp12", "pinv", "osqp")


def settings(law: str, **parameters: object):
    return load_controller_config({"controller": law, "robot": "ur5", "parameters": parameters})[0]


@pytest.mark.parametrize("law", LAWS)
def test_the_old_key_names_the_new_one(law):
    with pytest.raises(ConfigError) as caught:
        settings(law, frame="tool0", target_m=TARGET)
    assert caught.value.key == "parameters.frame"
    assert "reference_frame" in caught.value.remedy
    assert "point" in caught.value.remedy


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("more", [{"target_m": TARGET}, {}, {"point": None}])
def test_a_frame_of_observation_without_a_point_is_refused(law, more):
    with pytest.raises(ConfigError) as caught:
        settings(law, reference_frame="tool0", **more)
    assert caught.value.key == "parameters.reference_frame"
    assert "point: com" in caught.value.remedy


@pytest.mark.parametrize("more", [{"reference_frame": "tool0", "target_m": TARGET}, {}])
def test_a_point_seen_from_itself_is_refused(more):
    robot = describe(load_emulator_config("ur5", seed=0)[0])
    point = "tool0" if more else robot.default_task.reference
    with pytest.raises(ConfigError) as caught:
        build(settings("qp12", point=point, **more), robot)
    assert caught.value.key.endswith("reference_frame")


def test_the_point_moves_and_is_seen_from_the_reference_frame():
    robot = describe(load_emulator_config("ur5", seed=0)[0])
    given = {"point": "wrist_1_link", "reference_frame": "shoulder_link", "target_m": TARGET}
    task = build(settings("qp12", **given), robot).task
    kinematics, at = Kinematics(robot), np.zeros(3)
    point, seen_from = map(kinematics.frame_id, ("wrist_1_link", "shoulder_link"))
    kinematics.update(robot.initial_position)
    kinematics.frame(point, seen_from, at, np.zeros((3, 3)), np.zeros((6, robot.n)))
    task.update(kinematics)
    np.testing.assert_allclose(task.error, at - TARGET, atol=1e-12)
