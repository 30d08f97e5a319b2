"""Which of several kinds of command a robot and a controller agree on."""

from __future__ import annotations

import sys

import pytest

from hoap3.protocol.errors import DescriptionError
from hoap3.remote_controller.config import CONFIGS, ControllerConfig, build
from hoap3.remote_controller.controllers.base import agreed
from hoap3.remote_controller.registry import find
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.service import describe
from hoap3.tools.services.configs import load_controller_config, resolve_configs


def shipped(config: str) -> str:
    """The file of a shipped config, as errors name it."""
    return str(CONFIGS / f"{config}.yaml")


def chosen(robot: str, controller: str, command: str | None = None) -> str | None:
    emulator = EmulatorConfig(robot=robot, command=command)
    names = "config", shipped(controller)
    return resolve_configs(emulator, ControllerConfig(controller=controller), names)[0].command


@pytest.mark.parametrize(
    ("robot", "controller", "kind"),
    [
        ("ur5", "tsid", "torque"),
        ("baxter_left_arm", "tsid", "torque"),
        ("lwr", "joint_acceleration", "acceleration"),
        ("hoap3", "joint_acceleration", "position"),
        ("lwr", "qp12", "position"),
    ],
)
def test_an_open_command_is_the_first_that_the_controller_gives_and_the_robot_takes(
    robot, controller, kind
):
    assert chosen(robot, controller) == kind


def test_a_command_in_the_robots_config_stands():
    assert chosen("ur5", "tsid", "acceleration") == "acceleration"


def test_a_pair_that_has_no_command_in_common_is_refused_with_what_runs():
    with pytest.raises(DescriptionError, match=r"position.*torque") as caught:
        chosen("hoap3", "tsid")
    assert "--set" not in str(caught.value)  # no setting makes it run
    assert "baxter_left_arm" in str(caught.value)
    assert "qp12" in str(caught.value)


def test_a_robot_that_was_started_otherwise_is_told_how_to_start_it():
    lwr = describe(EmulatorConfig(robot="lwr"))
    assert lwr.command_kinds == ("position",)
    with pytest.raises(DescriptionError, match="--set command=torque") as caught:
        build(load_controller_config("ghc")[0], lwr, shipped("ghc"))
    assert "lwr_weightless" in str(caught.value)


def test_where_nothing_fits_both_are_named():
    with pytest.raises(DescriptionError, match=r"position.*torque"):
        agreed(("torque",), load("hoap3"))


def test_a_package_of_the_user_may_be_called_as_a_room(tmp_path, monkeypatch):
    package = tmp_path / "remote_controller"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "mine.py").write_text(
        "from hoap3.remote_controller.controllers.qp12.qp12 import Qp12Controller\n\n\n"
        "class Mine(Qp12Controller):\n    pass\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    try:
        assert find("remote_controller.mine:Mine", "mine.yaml").__name__ == "Mine"
    finally:
        for name in ("remote_controller", "remote_controller.mine"):
            sys.modules.pop(name, None)
