"""MJCF files as people write them: degrees, defaults, sensors of motors, other bodies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.robot_emulator.config import EmulatorConfig, read_config
from hoap3.robot_emulator.plant_factory import build_body
from hoap3.robot_emulator.plants.mujoco.plant import MujocoPlant
from hoap3.robot_emulator.service import describe

T = 0.001
LIMITS = '<limit lower="-2" upper="2" velocity="3" effort="50"/>'
INERTIAL = '<inertial pos="0 0 0.2" mass="1" diaginertia=".01 .01 .01"/>'
SECOND = f'<body name="b" pos="0 0 0.4">{INERTIAL}<joint name="second" axis="0 1 0"/></body>'
ARM = f'<body name="a">{INERTIAL}<joint name="first" axis="0 1 0"/>{SECOND}</body>'
WEIGHT = '<inertial pos="0 0 0" mass="3" diaginertia=".1 .1 .1"/>'
FREE = f'<body name="trunk" pos="0 0 1"><freejoint/>{WEIGHT}{ARM}</body>'
TABLE = '<body name="table" pos="2 0 0.5"><geom type="box" size=".5 .5 .5"/></body>'
CUBE = f'<body name="cube" pos="5 0 3"><freejoint/>{WEIGHT}</body>'


def urdf() -> str:
    """Two pendulums, one on the other."""
    inertia = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<inertial><origin xyz="0 0 0.2"/><mass value="1"/>{inertia}</inertial>'
    links = "".join(f'<link name="{name}">{inertial}</link>' for name in "ab")
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 {height}"/><axis xyz="0 1 0"/>{LIMITS}</joint>'
        for name, parent, child, height in (("first", "base", "a", 0), ("second", "a", "b", 0.4))
    )
    return f'<robot name="two"><link name="base"/>{links}{joints}</robot>'


def plant(
    folder: Path, world: str = ARM, before: str = "", after: str = "", kind: str = "position",
    **parameters: Any,
) -> MujocoPlant:  # fmt: skip
    """The two pendulums from a file by hand, at rest in their start posture."""
    (folder / "two.urdf").write_text(urdf())
    (folder / "robot.yaml").write_text(
        "name: two\nurdf: two.urdf\ncommand_kinds: [position, acceleration, torque]\n"
    )
    text = f"<mujoco>{before}<worldbody>{world}</worldbody>{after}</mujoco>"
    (folder / "two.xml").write_text(text)
    file = folder / "mine.yaml"
    body = {"kind": "mujoco", "parameters": {"mjcf": "two.xml", **parameters}}
    file.write_text(yaml.safe_dump({"robot": "./robot.yaml", "command": kind, "plant": body}))
    content, where = read_config(str(file))
    config = parse(EmulatorConfig, content, where)
    description = describe(config, where)
    made = build_body(description, config)[0]
    assert isinstance(made, MujocoPlant)
    made.reset(description.initial_position)
    return made


@pytest.mark.parametrize("angle", ["degree", "radian"])
def test_stops_are_those_of_the_description_whatever_the_file_counts_in(tmp_path: Path, angle: str):
    made = plant(tmp_path, before=f'<compiler angle="{angle}"/>')
    np.testing.assert_allclose(made.model.jnt_range, [[-2.0, 2.0], [-2.0, 2.0]])
    assert made.model.jnt_limited.all()


def test_what_we_add_has_none_of_the_defaults_of_the_file(tmp_path: Path):
    motor = '<motor ctrlrange="-1 1" ctrllimited="true" gear="100" armature="3"/>'
    default = f'<default>{motor}<geom condim="1" margin="0.2"/><site pos="1 2 3"/></default>'
    made = plant(tmp_path, before=default, kind="torque", contact_frames=["b"], floor={})
    np.testing.assert_array_equal(made.model.actuator_gear[:, 0], 1.0)
    assert not made.model.actuator_ctrllimited.any()
    made.step(np.array([2.0, 2.0]), T)  # beyond the file's range
    np.testing.assert_allclose(made.tau, 2.0)
    np.testing.assert_allclose(made.model.dof_armature, 0.0)
    floor = made.model.geom("floor")
    assert (int(floor.condim[0]), float(floor.margin[0])) == (3, 0.0)
    np.testing.assert_allclose(made.data.site("frame b").xpos, made.data.body("b").xpos)


def test_motors_of_the_file_go_with_what_measures_them(tmp_path: Path):
    motors = '<actuator><motor name="m" joint="first"/></actuator>'
    sensors = '<sensor><actuatorfrc actuator="m"/><jointpos joint="first"/></sensor>'
    made = plant(tmp_path, after=motors + sensors)
    assert (made.model.nu, made.model.nsensor) == (2, 1)


def test_a_site_of_the_file_stands_for_a_frame_as_it_is_turned(tmp_path: Path):
    turned = ARM.replace(INERTIAL, f'{INERTIAL}<site name="hand" pos="0 0 .1" euler="0 90 0"/>', 1)
    made = plant(tmp_path, turned, imu_frames=["hand"])
    made.step(made.start, T)
    assert made.imu[7:] == pytest.approx([-9.81, 0.0, 0.0], abs=1e-6)  # its x points down


def test_a_joint_that_slides_in_the_file_and_turns_in_the_description_is_named(tmp_path: Path):
    with pytest.raises(ConfigError) as found:
        plant(tmp_path, ARM.replace('name="second"', 'name="second" type="slide"'))
    assert (found.value.key, found.value.value) == ("plant.parameters.mjcf", "second")


@pytest.mark.parametrize("world", [TABLE + ARM, CUBE + ARM, ARM + CUBE])
def test_figures_are_those_of_the_robot_and_not_of_what_stands_beside_it(
    tmp_path: Path, world: str
):
    alone, among = plant(tmp_path), plant(tmp_path, world)
    for each in (alone, among):
        each.step(each.start, T)
    assert among.summary()["com_world_m"] == pytest.approx(alone.summary()["com_world_m"])
    np.testing.assert_allclose(among.gains.rate_limit, alone.gains.rate_limit)


@pytest.mark.parametrize("world", [CUBE + FREE, FREE + CUBE])
@pytest.mark.parametrize("kind", ["position", "torque"])
def test_the_base_is_that_of_the_robot_and_not_a_cubes(tmp_path: Path, world: str, kind: str):
    given = {"base": "free", "imu_frames": [], "position_m": [0.0, 0.0, 3.0]}
    alone, among = plant(tmp_path, FREE, kind=kind, **given), plant(
        tmp_path, world, kind=kind, **given)  # fmt: skip
    np.testing.assert_array_equal(among.base[:3], [0.0, 0.0, 3.0])
    np.testing.assert_array_equal(among.data.body("cube").xpos, [5.0, 0.0, 3.0])
    for each in (alone, among):
        for _ in range(50):
            each.step(0.1 + each.start, T)
    assert np.abs(alone.base[10:13]).max() > 0.01
    np.testing.assert_allclose(among.base, alone.base, atol=1e-9)
    assert among.summary()["com_world_m"] == pytest.approx(alone.summary()["com_world_m"])
    if kind == "torque":
        needed, beside = np.zeros((2, 2))
        for each, found in ((alone, needed), (among, beside)):
            assert each.torque_model is not None
            each.torque_model.torques(np.array([1.0, -2.0]), T, found)
        np.testing.assert_allclose(beside, needed, rtol=1e-6)


def test_a_file_without_a_floor_says_that_its_robot_falls(tmp_path: Path):
    given = {"base": "free", "imu_frames": []}
    falls, held = plant(tmp_path, FREE, **given), plant(tmp_path)
    assert "floor" in " ".join(falls.notes())
    assert "100.0%" in " ".join(falls.notes())
    put = plant(tmp_path, FREE, position_m=[0.0, 0.0, 1.0], floor={}, **given)
    for each in (held, put):
        assert "floor" not in " ".join(each.notes())
        assert "weight" not in " ".join(each.notes())


def test_joints_of_two_free_bodies_are_no_robot(tmp_path: Path):
    apart = FREE.replace(SECOND, "") + f'<body name="other"><freejoint/>{WEIGHT}{SECOND}</body>'
    with pytest.raises(ConfigError):
        plant(tmp_path, apart, base="free", imu_frames=[])


KEYS = {
    "one of three": ('<position joint="first"/>', '<key name="home" qpos="0 0.5" ctrl="0.1"/>'),
    "all": (
        '<position joint="first"/><position joint="second"/>',
        '<key qpos="0 0.5" ctrl="0 0.5"/>',
    ),
    "three": (
        '<motor joint="first"/><motor joint="second"/><motor joint="second"/>',
        '<key qpos="0 0.5" ctrl="0 0.5 1"/>',
    ),
    "with activation": (
        '<general joint="first" dyntype="integrator"/>',
        '<key qpos="0 0.5" ctrl="1" act="0.3"/>',
    ),
}


@pytest.mark.parametrize("kind", ["position", "torque"])
@pytest.mark.parametrize("case", KEYS)
def test_key_frames_of_replaced_actuators_are_no_obstacle(tmp_path: Path, case: str, kind: str):
    actuators, key = KEYS[case]
    after = f"<actuator>{actuators}</actuator><keyframe>{key}</keyframe>"
    made = plant(tmp_path, after=after, kind=kind)
    np.testing.assert_array_equal(made.model.key_qpos, [[0.0, 0.5]])
    count = actuators.count("joint=")
    assert any(f"{count} actuators" in line for line in made.notes())


def differing(made: MujocoPlant) -> str:
    return "".join(line for line in made.notes() if "controllers know" in line)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("", "", ""),
        ('pos="0 0 0.4"', 'pos="0 0 0.7"', "b by 0.3 m"),
        ('name="first" axis="0 1 0"', 'name="first" axis="0 -1 0"', "first has another axis"),
        ('name="second" axis="0 1 0"', 'name="second" axis="1 0 0"', "second has another axis"),
        ('mass="1"', 'mass="2"', "4 kg move instead of 2 kg"),
        ('mass="1"', 'mass="1.01"', ""),
    ],
)
def test_a_file_of_another_robot_is_named(tmp_path: Path, old: str, new: str, named: str):
    found = differing(plant(tmp_path, world=ARM.replace(old, new)))
    assert (named in found) if named else not found


def test_a_floating_robot_is_compared_as_its_base_stands(tmp_path: Path):
    (tmp_path / "free").mkdir()
    turned = FREE.replace('pos="0 0 1"', 'pos="3 0 1" euler="0 0 40"').replace("trunk", "base")
    world = turned.replace('mass="3"', 'mass="1e-3"')
    assert not differing(plant(tmp_path / "free", world=world, base="free", position_m=[1, 2, 3]))


@pytest.mark.parametrize(("height", "deep"), [(-1.0, False), (0.55, True)])
def test_a_start_inside_the_floor_is_named(tmp_path: Path, height: float, deep: bool):
    ball = '<geom type="sphere" size="0.1" pos="0 0 0.2" mass="0"/></body>'
    world = ARM.replace("</body></body>", f"{ball}</body>")
    floor = f'<geom type="plane" size="9 9 1" pos="0 0 {height}"/>'
    made = plant(tmp_path, world=f"{floor}{world}")
    said = [line for line in made.notes() if "inside what stands still" in line]
    assert bool(said) == deep
    assert all("b by" in line for line in said)
