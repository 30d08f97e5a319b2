"""Which of several kinds of command a robot and a controller agree on."""

from __future__ import annotations

import pytest

from protocol.errors import DescriptionError
from remote_controller.config import ControllerConfig
from remote_controller.controllers.controller import agreed
from robot_emulator.config import EmulatorConfig
from robot_emulator.robots import load
from tools.simulate import suited


def chosen(robot: str, controller: str, command: str | None = None) -> str | None:
    emulator = EmulatorConfig(robot=robot, command=command)
    return suited(emulator, ControllerConfig(controller=controller), "config").command


@pytest.mark.parametrize(
    ("robot", "controller", "kind"),
    [
        ("ur5", "tsid", "torque"),
        ("baxter_left_arm", "tsid", "torque"),
        ("lwr", "joint_acceleration", "acceleration"),
        ("hoap3", "joint_acceleration", "position"),
        ("lwr", "qp12", "position"),
        ("hoap3", "tsid", None),
    ],
)
def test_an_open_command_is_the_first_that_the_controller_gives_and_the_robot_takes(
    robot, controller, kind
):
    assert chosen(robot, controller) == kind


def test_a_command_in_the_robots_config_stands():
    assert chosen("ur5", "tsid", "acceleration") == "acceleration"


def test_where_nothing_fits_both_are_named():
    with pytest.raises(DescriptionError, match="takes position, and the controller gives torque"):
        agreed(("torque",), load("hoap3"))
