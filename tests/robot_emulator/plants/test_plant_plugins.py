"""Plants by name: ours, an installed package's, the user's own, and names of none."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError, NotInstalledError, UnknownNameError
from hoap3.robot_emulator.config import EmulatorConfig, read_config
from hoap3.robot_emulator.plant_factory import build_body
from hoap3.robot_emulator.plants.acceleration_servo import AccelerationServo
from hoap3.robot_emulator.plants.position_servo import PositionServo
from hoap3.robot_emulator.plants.rigid_body import RigidBody
from hoap3.robot_emulator.service import describe
from hoap3.tools.services.simulate import simulate

SPRINGY = """
from pydantic import Field
from hoap3.robot_emulator.plants.base import Declared, Plant

class Springy(Plant):
    commands = ("position",)
    class Parameters(Plant.Parameters):
        share: float = Field(0.1, gt=0, le=1)
    def __init__(self, description, parameters):
        super().__init__(description, parameters)
        self._share = parameters.share
    @classmethod
    def declare(cls, description, settings, parameters):
        return Declared(imu=10)
    def reset(self, q):
        self.q[:] = self.start[:] = q
    def step(self, command, dt):
        self.q += self._share * (command - self.q)
        self.imu[0] += 1.0
    def hold(self, dt):
        pass
"""


def config(**content: object) -> EmulatorConfig:
    return parse(EmulatorConfig, {"robot": "lwr", **content}, "my.yaml")


def plant_of(**content: object) -> object:
    settings = config(**content)
    return build_body(describe(settings, "my.yaml"), settings)[0]


def test_without_a_name_the_command_decides():
    assert type(plant_of(command="position")) is PositionServo
    assert type(plant_of(command="acceleration")) is AccelerationServo
    assert type(plant_of(command="torque")) is RigidBody
    assert type(plant_of(command="torque", plant={"kind": "rigid_body"})) is RigidBody


def test_an_unknown_name_has_the_nearest_one():
    with pytest.raises(UnknownNameError) as found:
        describe(config(plant={"kind": "mujocco"}), "my.yaml")
    assert found.value.nearest == "mujoco"


@pytest.mark.parametrize(
    ("content", "key"),
    [
        ({"command": "torque", "plant": {"kind": "servo"}}, "plant.kind"),
        ({"command": "position", "plant": {"kind": "rigid_body"}}, "plant.kind"),
        ({"command": "position", "plant": {"parameters": {"kp": 1.0}}}, "plant.parameters.kp"),
        ({"plant": {"kind": "mujoco", "parameters": {"kq": 1.0}}}, "plant.parameters.kq"),
        ({"plant": {"kind": "mujoco", "servo": "lag"}}, "plant.servo"),
        (
            {"plant": {"kind": "mujoco", "parameters": {"kp": {"link_9": 1.0}}}},
            "plant.parameters.kp",
        ),
        (
            {"plant": {"kind": "mujoco", "parameters": {"kv": {"joint_2": 0.0}}}},
            "plant.parameters.kv.joint_2",
        ),
        (
            {"plant": {"kind": "mujoco", "parameters": {"imu_frames": ["hand"]}}},
            "plant.parameters.imu_frames.0",
        ),
        (
            {"plant": {"kind": "mujoco", "parameters": {"collide": ["hand"]}}},
            "plant.parameters.collide.0",
        ),
        (
            {
                "command": "acceleration",
                "plant": {"kind": "mujoco", "parameters": {"base": "free"}},
            },
            "plant.parameters.base",
        ),
        ({"plant": {"kind": "no_such_module:Plant"}}, "plant.kind"),
        ({"plant": {"kind": "json:JSONDecoder"}}, "plant.kind"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_key(content: dict, key: str):
    with pytest.raises(ConfigError) as found:
        plant_of(**{"command": "position", **content})
    assert found.value.key == key


def test_a_plant_declares_itself_under_the_gravity_that_it_gets():
    """Without any, nothing falls, and the start of a free base needs no support."""
    floating = {"kind": "mujoco", "gravity": "none", "parameters": {"base": "free"}}
    described = describe(config(command="position", plant=floating), "my.yaml")
    assert described.servo_rate_1_s is not None


def test_without_the_extra_its_command_is_told(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(NotInstalledError, match=r"pip install 'hoap3\[mujoco\]'"):
        describe(config(command="position", plant={"kind": "mujoco"}), "my.yaml")
    describe(config(command="position"), "my.yaml")


def test_the_users_own_lies_beside_its_config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "springs.py").write_text(SPRINGY)
    file = tmp_path / "springs.yaml"
    file.write_text("robot: hoap3\nplant: {kind: 'springs:Springy', parameters: {share: 0.5}}\n")
    run = simulate(read_config(str(file))[0], "qp12", 0.05)
    assert run.states["imu"][-1][0] > 40.0
    moved = run.states["q"][-1] != run.states["reference"][-1]
    assert moved.any()
    sys.modules.pop("springs")


def test_an_installed_packages_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    info = tmp_path / "springs_pack-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Name: springs-pack\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[hoap3.plants]\nsprings = springs_pack:Springy\n")
    (tmp_path / "springs_pack.py").write_text(SPRINGY)
    monkeypatch.syspath_prepend(str(tmp_path))
    plant = plant_of(command="position", plant={"kind": "springs"})
    assert type(plant).__name__ == "Springy"
    sys.modules.pop("springs_pack")
