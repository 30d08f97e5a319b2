"""Robots by name, by path and by entry point; what their YAML may leave out, and may not."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from support.arm3 import URDF, YAML, describe, write

import hoap3.robot_emulator.robots
from hoap3.protocol.errors import ConfigError, DescriptionError, UnknownNameError
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.robot_emulator.robots import available, load

SHIPPED = Path(hoap3.robot_emulator.robots.__file__).parent / "hoap3"


def test_minimal_arm_outside_the_repository(tmp_path):
    arm = load(write(tmp_path))
    assert arm.name == "arm3"
    assert arm.joint_names == ("shoulder", "elbow", "wrist")
    assert arm.lower.tolist() == arm.lower_hard.tolist() == [-2.5, 0.1, -1.5]
    assert arm.upper.tolist() == arm.upper_hard.tolist() == [2.5, 2.4, 1.5]
    assert arm.velocity.tolist() == [2.0, 2.5, 4.0]
    assert arm.effort.tolist() == [20.0, 12.0, 4.0]
    assert arm.setpoint_acceleration_max.tolist() == [500.0, 625.0, 1000.0]
    assert arm.brake_acceleration.tolist() == [20.0, 25.0, 40.0]
    assert arm.counts_per_rad is None
    assert arm.armature.tolist() == [0.0, 0.0, 0.0]
    assert arm.postures == {"zero": (0.0, 0.1, 0.0)}
    assert arm.initial_position.tolist() == [0.0, 0.1, 0.0]
    assert arm.period_s == 0.001
    assert arm.base_frame == "base"
    assert arm.soles == arm.wrench_sensors == ()
    assert arm.command_kinds == ("position",)
    assert build_model(arm).total_mass == pytest.approx(3.6)


def test_folder_file_and_relative_path_are_the_same_robot(tmp_path, monkeypatch):
    file = write(tmp_path)
    by_file = load(str(file))
    assert load(tmp_path) == load(str(tmp_path)) == by_file
    other = file.rename(tmp_path / "other.yaml")
    monkeypatch.chdir(tmp_path)
    assert load("other.yaml") == load("./other.yaml") == load(other) == by_file


FULL = (
    YAML
    + """
setpoint_acceleration_max: 300.0
brake_acceleration: 15
joints:
  - wrist
  - {name: shoulder, lower: -2.0, lower_hard: -2.2, upper_hard: 2.6, brake_acceleration: 9.0}
  - {name: elbow, velocity: 1.0, effort: 10, effort_average: 5.0, encoder_counts_per_rad: -1000.0,
     armature: 0.02}
initial_posture: home
postures:
  home: [0.5, -1.0, 1.0]
  zero: [0.0, 0.0, 0.2]
period_s: 0.002
command_kinds: [position, torque]
soles:
  - {frame: tool, polygon: [[0.1, 0.0], [0.0, 0.1], [-0.1, 0.0]]}
base_frame: tool
wrench_sensors: [hand]
"""
)


def test_what_the_file_says_comes_before_the_urdf_and_the_defaults(tmp_path):
    arm = load(write(tmp_path, FULL))
    assert arm.joint_names == ("wrist", "shoulder", "elbow")
    assert arm.lower.tolist() == [-1.5, -2.0, 0.1]
    assert arm.lower_hard.tolist() == [-1.5, -2.2, 0.1]
    assert arm.upper_hard.tolist() == [1.5, 2.6, 2.4]
    assert arm.velocity.tolist() == [4.0, 2.0, 1.0]
    assert arm.effort.tolist() == [4.0, 20.0, 10.0]
    assert arm.setpoint_acceleration_max.tolist() == [300.0] * 3
    assert arm.brake_acceleration.tolist() == [15.0, 9.0, 15.0]
    assert [joint.effort_average for joint in arm.joints] == [None, None, 5.0]
    assert [joint.encoder_counts_per_rad for joint in arm.joints] == [None, None, -1000.0]
    assert arm.armature.tolist() == [0.0, 0.0, 0.02]
    assert arm.initial_position.tolist() == [0.5, -1.0, 1.0]
    assert arm.postures["zero"] == (0.0, 0.0, 0.2)
    assert arm.period_s == 0.002
    assert arm.command_kinds == ("position", "torque")
    assert arm.base_frame == arm.soles[0].frame == "tool"
    assert arm.wrench_sensors == ("hand",)


def centre_of_mass(robot, q):
    model = build_model(robot)
    q_pinocchio = np.empty(robot.n)
    q_pinocchio[model.order] = q
    return pin.centerOfMass(model.model, model.data, q_pinocchio).copy()


def test_shuffled_wire_order_moves_the_same_robot(tmp_path):
    content = yaml.safe_load((SHIPPED / "robot.yaml").read_text(encoding="utf-8"))
    rng = np.random.default_rng(7)
    shuffle = rng.permutation(21)
    content["joints"] = [content["joints"][k] for k in shuffle]
    content["postures"] = {
        name: [values[k] for k in shuffle] for name, values in content["postures"].items()
    }
    content["urdf"] = str(SHIPPED / "hoap3.urdf")
    file = tmp_path / "shuffled.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    hoap3, shuffled = load("hoap3"), load(file)
    assert shuffled.joint_names == tuple(hoap3.joint_names[k] for k in shuffle)
    assert build_model(shuffled).order.tolist() != build_model(hoap3).order.tolist()
    for _ in range(20):
        q = rng.uniform(hoap3.lower, hoap3.upper)
        np.testing.assert_array_equal(
            centre_of_mass(shuffled, q[shuffle]), centre_of_mass(hoap3, q)
        )
        assert not np.allclose(centre_of_mass(shuffled, q), centre_of_mass(hoap3, q))


def test_unknown_name_carries_the_nearest():
    with pytest.raises(UnknownNameError, match=r"'hoap'.*'hoap3'") as caught:
        load("hoap")
    assert caught.value.nearest == "hoap3"


WRONG = [  # YAML and key
    (YAML + "velocty: 3.0\n", "velocty"),
    (YAML + "joints: [{name: wrist, sped: 1.0}]\n", "joints.0.sped"),
    ("urdf: arm3.urdf\n", "name"),
    (YAML.replace("name: arm3", "name: Arm-3"), "name"),
    (YAML + "period_s: '1e-3'\n", "period_s"),
    (YAML + "period_s: .nan\n", "period_s"),
    (YAML + "postures: {zero: [a, b, c]}\n", "postures.zero.0"),
    (YAML + "joints: [1]\n", "joints.0"),
    (YAML + "soles: [{frame: tool, outline: []}]\n", "soles.0.outline"),
    (YAML + "command_kinds: [speed]\n", "command_kinds.0"),
    (YAML.replace("arm3.urdf", "arm4.urdf"), "urdf"),
    (YAML.replace("arm3.urdf", "."), "urdf"),
    ("name: [arm3\n", ""),
]


@pytest.mark.parametrize(("content", "key"), WRONG)
def test_wrong_file_is_named_with_its_key(tmp_path, content, key):
    file = write(tmp_path, content)
    with pytest.raises(ConfigError) as caught:
        load(file)
    assert caught.value.file == str(file)
    assert caught.value.key == key
    assert caught.value.remedy


def test_missing_file_is_named(tmp_path):
    for path in (tmp_path / "none.yaml", tmp_path / "none", tmp_path):
        with pytest.raises(ConfigError, match=str(path)):
            load(str(path))


def test_urdf_that_is_not_text_or_too_large(tmp_path):
    file = write(tmp_path)
    (tmp_path / "arm3.urdf").write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match="UTF-8"):
        load(file)
    (tmp_path / "arm3.urdf").write_text(URDF + " " * (1 << 20), encoding="utf-8")
    with pytest.raises(ConfigError, match="1 MiB"):
        load(file)


UNFIT = [  # YAML, names and values
    ("joints: [shoulder, elbw, wrist]\n", "'elbw'"),
    ("postures: {home: [0.0, 0.0, 0.0]}\n", "'elbow'.*0.0"),
    ("initial_posture: zeros\n", "'zeros'.*'zero'"),
    ("joints: [shoulder, {name: elbow, velocity: 0.0}, wrist]\n", "'elbow'.*velocity.*0.0"),
]


@pytest.mark.parametrize(("content", "named"), UNFIT)
def test_figures_that_do_not_hold_together(tmp_path, content, named):
    file = write(tmp_path, YAML + content)
    with pytest.raises(DescriptionError, match=rf"^{file}: robot 'arm3': .*{named}"):
        load(file)


def test_range_that_neither_file_gives(tmp_path):
    silent = URDF.replace('lower="0.1" upper="2.4" ', "")
    with pytest.raises(DescriptionError, match="'elbow'"):
        load(write(tmp_path, urdf=silent))
    told = YAML + "joints: [shoulder, {name: elbow, lower: 0.2, upper: 1.0}, wrist]\n"
    assert load(write(tmp_path, told, silent)).lower[1] == 0.2


def declare(folder: Path, monkeypatch, target: str) -> None:
    """A distribution with one robot, as pip would leave it."""
    info = folder / "arms-1.0.dist-info"
    info.mkdir(exist_ok=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: arms\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[hoap3.robots]\narm3 = {target}\n")
    (folder / "arms_of_a_test.py").write_text(
        "from pathlib import Path\n"
        "from support.arm3 import describe as made\n"
        "FOLDER = Path(__file__).parent\n"
        "FILE = str(FOLDER / 'robot.yaml')\n"
        "NUMBER = 3\n"
        "def forgotten(): return {}['mass']\n"
        "def gone(): raise FileNotFoundError('no robot.yaml there')\n"
    )
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, "arms_of_a_test", raising=False)


@pytest.mark.parametrize("attribute", ["FOLDER", "FILE", "made"])
def test_robot_of_another_distribution(tmp_path, monkeypatch, attribute):
    file = write(tmp_path)
    declare(tmp_path, monkeypatch, f"arms_of_a_test:{attribute}")
    assert set(available()) > {"arm3", "hoap3"}
    assert load("arm3") == (describe() if attribute == "made" else load(file))


@pytest.mark.parametrize(
    ("target", "named"),
    [
        ("arms_of_a_test:NOTHING", "NOTHING"),
        ("no_such_module_of_a_test:ROBOT", "no_such_module_of_a_test"),
        ("arms_of_a_test:NUMBER", ""),
        ("arms_of_a_test:forgotten", "KeyError: 'mass'"),
        ("arms_of_a_test:gone", "no robot.yaml there"),
    ],
)
def test_broken_entry_point_is_named(tmp_path, monkeypatch, target, named):
    declare(tmp_path, monkeypatch, target)
    with pytest.raises(ConfigError, match=rf"arm3 of hoap3\.robots.*{named}"):
        load("arm3")
