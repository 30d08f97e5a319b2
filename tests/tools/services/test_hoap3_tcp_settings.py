"""Settings of HOAP-3's protocol with which nothing can be reached are named at the start."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml
from support.command_bench import inside

from hoap3.robot_emulator import robots

ROBOTS = Path(robots.__file__).parent


def refused(side: str, name: str, *settings: str) -> str:
    """What a service says of its settings."""
    words = [word for text in ("link.kind=hoap3_tcp", *settings) for word in ("--set", text)]
    done = inside(side, name, "--no-realtime", "--set", "log.record=false", *words)
    assert done.code in {1, 2}, done.stderr  # 1 where the machine refuses them
    assert "Traceback" not in done.stderr
    return done.stderr


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("link.hoap3_tcp.robot=hoap4", "link.hoap3_tcp.robot"),
        ("link.hoap3_tcp.robot=ur5", "encoder_counts_per_rad"),
        ("link.hoap3_tcp.init_port=0", "link.hoap3_tcp.init_port"),
        ("link.hoap3_tcp.control_port=0", "link.hoap3_tcp.control_port"),
        ("link.hoap3_tcp.control_port=2600", "link.hoap3_tcp"),
        ("link.hoap3_tcp.slots=20", "link.hoap3_tcp.slots"),
        ("link.hoap3_tcp.order=robot", "link.hoap3_tcp.order"),
        ("link.hoap3_tcp.check_s=0", "link.hoap3_tcp.check_s"),
        ("link.kind=tcp", "link.kind"),
    ],
)
def test_of_a_controller(setting: str, named: str) -> None:
    assert named in refused("controller", "qp12", setting)


@pytest.mark.parametrize(
    ("robot", "setting", "named"),
    [
        ("ur5", "link.hoap3_tcp.slots=22", "encoder_counts_per_rad"),
        ("humanoid32", "command=torque", "link.kind"),
        ("hoap3", "link.hoap3_tcp.control_port=2600", "link.hoap3_tcp"),
        ("hoap3", "link.hoap3_tcp.host=not.an.address.invalid", "link.hoap3_tcp.host"),
    ],
)
def test_of_an_emulator(robot: str, setting: str, named: str) -> None:
    assert named in refused("emulator", robot, setting)


def test_a_robot_with_more_joints_than_slots(tmp_path: Path) -> None:
    folder = tmp_path / "many"
    shutil.copytree(ROBOTS / "humanoid32", folder)
    file = folder / "robot.yaml"
    content = yaml.safe_load(file.read_text())
    for joint in content["joints"]:
        joint["encoder_counts_per_rad"] = 1000.0
    file.write_text(yaml.safe_dump(content))
    said = refused("controller", "qp12", f"link.hoap3_tcp.robot={folder}")
    assert "link.hoap3_tcp.robot" in said
    assert "21" in said
