"""What `hoap3 run` starts with: within the limits of any robot, and of no robot in particular."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
import yaml

from hoap3.protocol.runtime.recorder import NoRecorder
from hoap3.remote_controller.config import CONFIGS
from hoap3.remote_controller.pairs import DEFAULT_CONFIG
from hoap3.robot_emulator.robots import available, load
from hoap3.tools.cli.app import run
from hoap3.tools.cli.measurements import soak
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.simulate import Lockstep, simulate

T = 1e-3
NEAR_STOP = """
<robot name="near_stop"><link name="base"/><link name="arm"/><link name="tip"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="0.05" velocity="1" effort="1"/></joint>
<joint name="slide" type="prismatic"><parent link="arm"/><child link="tip"/>
<origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
<limit lower="-0.2" upper="0.2" velocity="0.1" effort="1"/></joint></robot>
"""
ROBOT = """
name: near_stop
urdf: near_stop.urdf
brake_acceleration: 2.0
setpoint_acceleration_max: 2.0
default_task: {point: tip, reference: base, move_m: [0.0, 0.05, 0.0]}
"""


@pytest.mark.parametrize("started", [run, soak, simulate])
def test_it_is_the_default_of_each_command(started):
    assert DEFAULT_CONFIG == "qp12_bounded"
    assert inspect.signature(started).parameters["controller"].default == DEFAULT_CONFIG


def test_it_names_no_robot_joint_or_frame():
    text = (CONFIGS / f"{DEFAULT_CONFIG}.yaml").read_text(encoding="utf-8")
    words = {str(word) for word in _values(yaml.safe_load(text))}
    for name in available():
        robot = load(name)
        assert words.isdisjoint({name, *robot.joint_names, *robot.frames})


def _values(content: object) -> list[object]:
    if isinstance(content, dict):
        return [each for value in content.values() for each in _values(value)]
    if isinstance(content, list):
        return [each for value in content for each in _values(value)]
    return [content]


@pytest.fixture
def near_stop(tmp_path):
    (tmp_path / "near_stop.urdf").write_text(NEAR_STOP, encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(ROBOT, encoding="utf-8")
    return tmp_path


def test_it_reaches_a_target_past_a_stop_within_all_limits(near_stop):
    """The rotation alone would have to pass its stop: `qp12` drives it there."""
    held = simulate(str(near_stop), "qp12", duration=4.0)
    robot = load(near_stop)
    assert _beyond(held, robot)
    done = simulate(str(near_stop), duration=4.0)
    assert not _beyond(done, robot)
    assert np.sqrt(2.0 * done.setpoints["v"][-1]) < 1e-3


def test_a_joint_at_the_end_of_its_range_is_not_driven_past_it_by_rounding():
    """Of HOAP-3, whose waist starts at its stop at 0; encoders that count make it tremble."""
    emulator = load_emulator_config({"robot": "hoap3", "plant": {"encoder": "counts"}}, seed=0)[0]
    log = NoRecorder()
    lockstep = Lockstep(emulator, load_controller_config(DEFAULT_CONFIG)[0], log, log)
    lockstep.run(1.0)
    assert lockstep.robot.summary()["interventions"] == 0


def _beyond(done, robot) -> bool:
    """Whether a setpoint is beyond a limit of position, speed or acceleration."""
    asked, before = done.setpoints["values"], done.states["reference"]
    at = np.searchsorted(done.states["tick"], done.setpoints["tick"])
    speed = (asked - before[at]) / T
    change = np.abs(np.diff(speed, axis=0)) / T
    slack = 1.0 + 1e-9
    return bool(
        (asked > robot.upper + 1e-12).any()
        or (asked < robot.lower - 1e-12).any()
        or (np.abs(speed) > robot.velocity * slack).any()
        or (change > robot.setpoint_acceleration_max * slack + 1e-6).any()
    )
