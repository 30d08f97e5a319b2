"""What the shipped configs say of themselves is so."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import yaml
from story import check

from hoap3.protocol.messages import State
from hoap3.remote_controller.config import CONFIGS, build
from hoap3.remote_controller.controllers.qp12.qp12 import Qp12Controller
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.service import describe
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.settings import json_schema
from hoap3.tools.services.simulate import simulate

ROOT = CONFIGS.resolve().parents[1]
NAMES = sorted(path.stem for path in CONFIGS.glob("*.yaml"))


def comments(name: str) -> str:
    text = (CONFIGS / f"{name}.yaml").read_text(encoding="utf-8")
    return " ".join(re.findall(r"^# (.*)$", text, flags=re.MULTILINE))


@pytest.mark.parametrize("name", NAMES)
def test_commands_in_their_comments_work(name):
    for command in re.findall(r"`(hoap3 [^`]+)`", comments(name)):
        check(command)
        *_, schema, kind = command.split()
        assert schema == "schema"
        content = yaml.safe_load((CONFIGS / f"{name}.yaml").read_text(encoding="utf-8"))
        assert kind == content["controller"]
        parameters = json_schema(kind)["properties"]["parameters"]["properties"]
        assert content["parameters"].keys() <= parameters.keys()


@pytest.mark.parametrize("name", ["stable_qp_hoap3", "com_tracking"])
def test_the_left_foot_moves(name):
    robot = load("hoap3")
    kinematics = Kinematics(robot)
    left, right = (kinematics.frame_id(f"{side}_sole") for side in "lr")
    states = simulate("hoap3", name, duration=4.0).states
    places = np.empty((2, 3))
    for q, place in zip(states["q"][[0, -1]], places, strict=True):
        kinematics.update(q)
        kinematics.frame(left, right, place, np.empty((3, 3)), np.empty((6, robot.n)))
    assert np.linalg.norm(places[1] - places[0]) > 1e-3


def test_the_change_that_the_readme_shows_is_taken_by_the_config_that_it_names():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    request, name = re.search(r"`hoap3 change '(\{.*?\})'` \(with `(\w+)`\)", readme).groups()
    robot = describe(load_emulator_config("hoap3", seed=0)[0])
    controller = build(load_controller_config(name)[0], robot)
    state = State(robot.n)
    state.mode = State.ACTIVE
    state.q[:] = state.reference[:] = robot.initial_position
    controller.reset(state, None)
    controller.step(state)
    before = controller.changeable()["priorities"]
    controller.change(json.loads(request))
    for state.tick in range(1, 1500):
        controller.step(state)
    after = controller.changeable()["priorities"]
    assert after["alpha"] != before["alpha"]
    assert not after["moving"]


def test_the_papers_config_says_nothing_but_what_hoap3_does_by_default():
    content = yaml.safe_load((CONFIGS / "qp12_paper.yaml").read_text(encoding="utf-8"))
    robot = load("hoap3")
    written_out, by_default = (
        Qp12Controller(robot, Qp12Controller.Parameters(**parameters)).parameters
        for parameters in (content["parameters"], {})
    )
    assert written_out == by_default
