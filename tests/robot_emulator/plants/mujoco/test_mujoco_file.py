"""A robot from an MJCF file of the user's own, whose joints are found by name."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.robot_emulator.config import EmulatorConfig, read_config
from hoap3.robot_emulator.plant_factory import build_body
from hoap3.robot_emulator.plants.mujoco.plant import MujocoPlant
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.service import describe

T = 0.001


def write(folder: Path, *, free: bool = False, name: str = "lwr") -> Path:
    """The robot's URDF as MuJoCo writes it, with a motor of its own, and a config beside it."""
    spec = mujoco.MjSpec.from_string(load(name).urdf)
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    for sensor in load(name).wrench_sensors:  # the file needs a body or a site of that name
        spec.body(sensor).add_site(name=sensor)
    for geom in spec.geoms:  # its boxes overlap, and contacts of a file stay as they are
        geom.contype = geom.conaffinity = 0
    motor = spec.add_actuator(name="theirs", target=spec.joints[0].name)
    motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
    motor.set_to_position(kp=1e4)
    spec.compile()
    text = spec.to_xml()
    if free:
        inertial = '<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>'
        text = text.replace("<worldbody>", f'<worldbody><body name="b"><freejoint/>{inertial}')
        text = text.replace("</worldbody>", "</body></worldbody>")
    (folder / "robot.xml").write_text(text)
    base = "free" if free else "fixed"
    file = folder / "mine.yaml"
    parameters = f"{{mjcf: robot.xml, base: {base}, imu_frames: []}}"
    file.write_text(f"robot: {name}\nplant: {{kind: mujoco, parameters: {parameters}}}\n")
    return file


def plant(file: Path, **parameters: object) -> tuple[MujocoPlant, np.ndarray]:
    content, where = read_config(str(file))
    content["plant"]["parameters"] |= parameters
    config = parse(EmulatorConfig, content, where)
    description = describe(config, where)
    made = build_body(description, config)[0]
    assert isinstance(made, MujocoPlant)
    made.reset(description.initial_position)
    return made, description.initial_position


def test_it_is_the_same_robot_as_that_of_the_urdf(tmp_path: Path):
    theirs, start = plant(write(tmp_path))
    (tmp_path / "urdf.yaml").write_text(
        "robot: lwr\nplant: {kind: mujoco, parameters: {collide: none}}\n"
    )
    ours, _ = plant(tmp_path / "urdf.yaml")
    np.testing.assert_allclose(theirs.start, ours.start, atol=1e-5)
    for _ in range(100):
        for each in (theirs, ours):
            each.step(start + 0.02, T)
    np.testing.assert_allclose(theirs.q, ours.q, atol=1e-5)
    assert np.abs(theirs.q - start).max() > 0.01
    assert theirs.model.nu == ours.model.nu == len(start)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"mjcf": "/nowhere.xml"}, "plant.parameters.mjcf"),
        ({"base": "free"}, "plant.parameters.mjcf"),
        ({"contact_frames": ["no_such_site"]}, "plant.parameters.mjcf"),
        ({"joint_friction": False}, "plant.parameters.joint_friction"),
        ({"collide": "none"}, "plant.parameters.collide"),
    ],
)
def test_what_the_file_lacks_or_does_not_heed_is_named(tmp_path: Path, change: dict, key: str):
    file = write(tmp_path)
    with pytest.raises(ConfigError) as found:
        plant(file, **change)
    assert found.value.key == key


def test_a_joint_that_it_lacks_is_named_with_the_nearest(tmp_path: Path):
    file = write(tmp_path)
    text = (tmp_path / "robot.xml").read_text()
    name = load("lwr").joint_names[2]
    (tmp_path / "robot.xml").write_text(text.replace(f'"{name}"', f'"{name}_"'))
    with pytest.raises(ConfigError, match=f"{name}_") as found:
        plant(file)
    assert found.value.value == name


def test_a_free_base_of_a_file_falls_from_where_the_config_puts_it(tmp_path: Path):
    made, _ = plant(write(tmp_path, free=True), position_m=[0.0, 0.0, 2.0])
    assert made.base[2] == 2.0
    for _ in range(100):
        made.step(made.start, T)
    assert made.base[9] == pytest.approx(-0.981, rel=0.05)
