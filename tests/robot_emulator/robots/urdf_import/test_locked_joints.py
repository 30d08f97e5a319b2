"""Joints that cannot move are locked with a note; --lock-joint and --tip choose others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.command_bench import inside
from support.urdfs.vendor_arm import JOINTS, LIMIT, LINKS, joint, link, urdf, vendor_folder

import hoap3
from hoap3.protocol.errors import ConfigError, DescriptionError
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.robot_emulator.robots.urdf_import.imported import ImportedRobot, import_robot
from hoap3.robot_emulator.service import EmulatorConfig, describe
from hoap3.tools.logs.log import Log

pytestmark = pytest.mark.filterwarnings("ignore::hoap3.protocol.errors.UrdfWarning")


def limit(lower: float, upper: float, velocity: float = 0.1) -> str:
    return f'<limit lower="{lower}" upper="{upper}" velocity="{velocity}" effort="20"/>'


def arm_with(*joints: str, links: str = "") -> str:
    fingers = link("left") + link("right") + link("tip")
    return urdf(LINKS + fingers + links, JOINTS + "".join(joints))


FINGER = limit(0.0, 0.04)
GRIPPER = (
    joint("left_joint", "hand", "left", FINGER, "prismatic"),
    joint("right_joint", "hand", "right", f'{FINGER}<mimic joint="left_joint"/>', "prismatic"),
    joint("tip_joint", "left", "tip", kind="fixed"),
)


def imported(tmp_path: Path, text: str, **options: object) -> ImportedRobot:
    return import_robot(vendor_folder(tmp_path, text), **options)


def pose(robot: ImportedRobot, frame: str, **q: float) -> np.ndarray:
    model = build_model(robot.description)
    places = np.array([q.get(name, 0.0) for name in robot.description.joint_names])
    return model.pose_in(frame, "base", places)


STUCK = {
    "a slider": (limit(0.02, 0.02), "prismatic", [0.0, 0.02, 1.2]),
    "a slider at 0": (limit(0.0, 0.0), "prismatic", [0.0, 0.0, 1.2]),
    "a slider without limits": ("", "prismatic", [0.0, 0.0, 1.2]),
    "a hinge": (limit(0.5, 0.5), "revolute", [0.0, 0.0, 1.2]),
    "almost no room": (limit(0.5, 0.5 + 1e-9), "revolute", [0.0, 0.0, 1.2]),
    "a mimic joint with ratio 0": (
        f'{LIMIT}<mimic joint="wrist" multiplier="0" offset="0.5"/>', "revolute", [0.0, 0.0, 1.2],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", STUCK)
def test_a_joint_that_cannot_move_is_locked_with_a_note(case, tmp_path):
    given, kind, place = STUCK[case]
    text = urdf(LINKS + link("finger"), JOINTS + joint("grip", "hand", "finger", given, kind))
    robot = imported(tmp_path, text)
    assert robot.description.joint_names == ("shoulder", "elbow", "wrist")
    assert [note for note in robot.notes if note.names[:1] and note.names[0].startswith("grip at ")]
    np.testing.assert_allclose(pose(robot, "finger")[:3], place, atol=1e-8)
    if kind == "revolute":  # about y, by 0.5 rad
        turn = [0.0, np.sin(0.25), 0.0, np.cos(0.25)]
        np.testing.assert_allclose(pose(robot, "finger")[3:], turn, atol=1e-8)


def test_what_follows_a_locked_joint_stays_where_that_brings_it(tmp_path):
    left = joint("a", "hand", "left", limit(0.02, 0.02), "prismatic")
    right = f'{limit(0, 1)}<mimic joint="a" multiplier="2"/>'
    chain = '<mimic joint="b" multiplier="-1" offset="0.01"/>'
    robot = imported(
        tmp_path,
        arm_with(
            joint("c", "right", "tip", f"{limit(-1, 1)}{chain}", "prismatic"),
            left,
            joint("b", "hand", "right", right, "prismatic"),
        ),
    )
    np.testing.assert_allclose(pose(robot, "right")[:3], [0.0, 0.04, 1.2], atol=1e-8)
    np.testing.assert_allclose(pose(robot, "tip")[:3], [0.0, 0.01, 1.5], atol=1e-8)
    assert robot.description.structure.mimic_joints == {}


def test_a_robot_whose_only_joint_is_stuck_loads_and_says_that_nothing_moves(tmp_path):
    text = urdf(link("base") + link("tip"), joint("j", "base", "tip", limit(1.0, 1.0)))
    robot = imported(tmp_path, text)
    assert robot.description.n == 0
    np.testing.assert_allclose(pose(robot, "tip")[3:], [0, np.sin(0.5), 0, np.cos(0.5)], atol=1e-8)
    with pytest.raises(DescriptionError):
        describe(EmulatorConfig(robot=str(robot.source.path)))
    with pytest.raises(DescriptionError):  # nor from the network
        hoap3.RobotDescription.from_json(robot.description.to_json())


def test_a_joint_is_locked_where_it_is_asked_for(tmp_path):
    robot = imported(tmp_path, arm_with(*GRIPPER), lock_joints=["left_joint=0.03", "elbow"])
    assert robot.description.joint_names == ("shoulder", "wrist")
    np.testing.assert_allclose(pose(robot, "right")[:3], [0.0, 0.03, 1.2], atol=1e-8)
    names = [name for note in robot.notes if "locked" in note.text for name in note.names]
    assert names == ["elbow at 0", "left_joint at 0.03"]


def test_a_lock_of_a_name_with_an_equals_sign_means_that_name(tmp_path):
    text = urdf(joints=JOINTS.replace('"elbow"', '"a=1"'))
    for given, place in (("a=1", 0.0), ("a=1=0.5", 0.5)):
        robot = imported(tmp_path, text, lock_joints=[given])
        assert robot.description.joint_names == ("shoulder", "wrist")
        assert any(note.names == (f"a=1 at {place:g}",) for note in robot.notes)


@pytest.mark.parametrize("given", ["elbo", "elbow=5", "elbow=x", "elbow=nan", "rigid"])
def test_a_lock_that_makes_no_sense_is_refused(given, tmp_path):
    text = urdf(LINKS + link("tip"), JOINTS + joint("rigid", "hand", "tip", "", "fixed"))
    with pytest.raises((ConfigError, DescriptionError), match="--lock-joint"):
        imported(tmp_path, text, lock_joints=[given])


TOOLS = {
    "a gripper": (arm_with(*GRIPPER), "hand"),
    "a tool behind the flange": (
        arm_with(
            *GRIPPER,
            joint("f", "hand", "flange", kind="fixed"),
            joint("t", "flange", "my_tcp", kind="fixed"),
            links=link("flange") + link("my_tcp"),
        ),
        "my_tcp",
    ),
    "fingers that turn, and follow": (
        arm_with(
            joint("knuckle", "hand", "left"),
            joint("other", "hand", "right", f'{LIMIT}<mimic joint="knuckle"/>'),
            joint("end", "left", "tip", f'{LIMIT}<mimic joint="knuckle" multiplier="-1"/>'),
        ),
        "hand",
    ),
    "fingers of two joints": (
        arm_with(
            joint("left_joint", "hand", "left"),
            joint("right_joint", "hand", "right"),
            joint("end", "left", "tip", f'{LIMIT}<mimic joint="left_joint"/>'),
            joint("far", "right", "end", f'{LIMIT}<mimic joint="right_joint"/>'),
            links=link("end"),
        ),
        "hand",
    ),
    "a mimic joint of the wrist": (
        arm_with(joint("grip", "hand", "tip", f'{LIMIT}<mimic joint="wrist"/>')),
        "hand",
    ),
    "a tool on a shorter chain": (
        arm_with(
            joint("thumb", "hand", "left"),
            joint("t", "hand", "tool0", kind="fixed"),
            links=link("tool0"),
        ).replace(link("right") + link("tip"), ""),
        "tool0",
    ),
    "a flange at the base": (
        urdf(LINKS.replace('"upper"', '"base_flange"'), JOINTS.replace('"upper"', '"base_flange"')),
        "hand",
    ),
    "an axis that slides": (
        urdf(LINKS, JOINTS.replace(f'{LIMIT}<axis xyz="1 0 0"/>', limit(-0.3, 0.0)).replace(
            'name="wrist" type="revolute"', 'name="wrist" type="prismatic"')),
        "hand",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", TOOLS)
def test_the_tool_is_no_finger(case, tmp_path):
    text, tool = TOOLS[case]
    unused = [name for name in ("left", "right", "tip") if f'child link="{name}"' not in text]
    for name in unused:
        text = text.replace(link(name), "")
    assert imported(tmp_path, text).description.default_task.point == tool


def test_the_tip_is_chosen(tmp_path):
    robot = imported(tmp_path, arm_with(*GRIPPER), tip="fore")
    assert robot.description.default_task.point == "fore"
    for wrong in ("base", "for", "left_joint"):
        with pytest.raises(ConfigError, match="--tip"):
            imported(tmp_path, arm_with(*GRIPPER), tip=wrong)
    with pytest.raises(ConfigError, match=r"robot\.yaml"):
        hoap3.load_robot("ur5", tip="tool0")
    with pytest.raises(ConfigError, match="--lock-joint"):
        hoap3.load_robot("ur5", lock_joints=["elbow_joint"])


def test_run_check_and_import_take_both_options(tmp_path):
    path = vendor_folder(tmp_path, arm_with(*GRIPPER))
    given = "--tip", "fore", "--lock-joint", "wrist", "--lock-joint", "left_joint=0.01"
    told = inside("robot", "check", path, *given, "--json").json()
    assert [each["name"] for each in told["joints"]] == ["shoulder", "elbow"]
    assert told["default_task"]["point"] == "fore"
    assert inside("robot", "import", path, *given, "--out", tmp_path / "own").code == 0
    own = hoap3.load_robot(tmp_path / "own")
    assert (own.joint_names, own.default_task.point) == (("shoulder", "elbow"), "fore")
    run = "run", "--lockstep", "--duration", "0.05", "--json", "--robot", path
    done = inside(*run, *given, "--out", tmp_path / "log")
    log = Log.open(tmp_path / "log", "robot")
    assert log.description.joint_names == ("shoulder", "elbow"), done.stderr
