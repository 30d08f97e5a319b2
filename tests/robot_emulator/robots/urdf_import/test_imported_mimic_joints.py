"""What becomes of joints that follow others: <mimic> in a vendor's URDF."""

from __future__ import annotations

import pytest
from support.urdfs.vendor_arm import JOINTS, LIMIT, LINKS, joint, link, urdf, vendor_folder

from hoap3.protocol.errors import DescriptionError
from hoap3.robot_emulator.robots.urdf_import.imported import ImportedRobot, import_robot


def imported(tmp_path, text: str) -> ImportedRobot:
    return import_robot(vendor_folder(tmp_path, text))


def told(robot: ImportedRobot, about: str, name: str) -> list[str]:
    """Texts of the notes of a kind that hold for a name."""
    return [note.text for note in robot.notes if note.about == about and name in note.names]


def finger(inside: str, kind: str = "revolute") -> str:
    return urdf(LINKS + link("finger"), JOINTS + joint("grip", "hand", "finger", inside, kind))


def test_a_mimic_joint_is_no_joint_of_its_own(tmp_path):
    robot = imported(tmp_path, finger(f'{LIMIT}<mimic joint="wrist" multiplier="2" offset="0.1"/>'))
    assert robot.description.joint_names == ("shoulder", "elbow", "wrist")
    (mimic_joint,) = robot.description.structure.mimic_joints.values()
    assert (mimic_joint.name, mimic_joint.mimicked, mimic_joint.multiplier, mimic_joint.offset) == (
        "grip", "wrist", 2.0, 0.1,
    )  # fmt: skip
    assert robot.description.upper[2] == pytest.approx((2.5 - 0.1) / 2)
    assert told(robot, "read", "grip")


@pytest.mark.parametrize(
    ("limit", "left"),
    [
        ("-3 2.1", (-1.0, 1.55)),  # (0.1 - 2.1)/2, (0.1 + 3)/2
        ("-9 2.1", (-1.0, 2.5)),  # the other end stays the mimicked joint's
        ("6 9", (-2.0, 2.5)),  # nothing would be left, so it is not used
    ],
)
def test_a_mimic_joint_that_turns_the_other_way_narrows_the_other_end(tmp_path, limit, left):
    lower, upper = limit.split()
    inside = f'<limit lower="{lower}" upper="{upper}" velocity="3" effort="1"/>'
    mimic = '<mimic joint="wrist" multiplier="-2" offset="0.1"/>'
    robot = imported(tmp_path, finger(inside + mimic))
    found = robot.description.lower[2], robot.description.upper[2], robot.description.velocity[2]
    assert found == pytest.approx((*left, 1.5))
    assert bool(told(robot, "left out", "grip")) == (limit == "6 9")


def test_a_mimic_joint_of_a_mimic_joint_narrows_their_mimicked_joint(tmp_path):
    """wrist → grip by -2 q + 0.1 → claw by 1.5 q - 0.2 = -3 q - 0.05."""
    wide = '<limit lower="-9" upper="9" velocity="9" effort="1"/>'
    inside = '<limit lower="-3" upper="1.5" velocity="3" effort="1"/>'
    grip = f'{wide}<mimic joint="wrist" multiplier="-2" offset="0.1"/>'
    claw = f'{inside}<mimic joint="grip" multiplier="1.5" offset="-0.2"/>'
    joints = joint("claw", "finger", "tip", claw) + joint("grip", "hand", "finger", grip)
    text = urdf(LINKS + link("finger") + link("tip"), joints + JOINTS)
    robot = imported(tmp_path, text).description
    number = robot.joint_names.index("wrist")
    found = robot.lower[number], robot.upper[number], robot.velocity[number]
    assert found == pytest.approx((-1.55 / 3, 2.95 / 3, 1.0))


@pytest.mark.parametrize("kind", ["revolute", "prismatic", "continuous"])
def test_a_mimic_joint_without_limits_bounds_nothing(tmp_path, kind):
    robot = imported(tmp_path, finger('<mimic joint="wrist" multiplier="3"/>', kind)).description
    assert (robot.lower[2], robot.upper[2], robot.velocity[2]) == (-2.0, 2.5, 2.0)
    assert robot.effort[2] == 30.0


@pytest.mark.parametrize(
    ("lower", "upper"),
    [("2.6", "3"), ("1", "1"), ("1", "-1"), ("2e4", "3e4")],
    ids=["beside", "empty", "reversed", "far"],
)
def test_a_mimic_joints_range_against_its_masters_is_left_out(tmp_path, lower, upper):
    limit = f'<limit lower="{lower}" upper="{upper}" velocity="1" effort="1"/>'
    robot = imported(tmp_path, finger(f'{limit}<mimic joint="wrist"/>'))
    assert (robot.description.lower[2], robot.description.upper[2]) == (-2.0, 2.5)
    assert told(robot, "left out", "grip")


def test_what_follows_a_fixed_joint_is_fixed(tmp_path):
    text = finger(f'{LIMIT}<mimic joint="wrist"/>').replace(
        'name="wrist" type="revolute"', 'name="wrist" type="fixed"'
    )
    robot = imported(tmp_path, text)
    assert robot.description.joint_names == ("shoulder", "elbow")
    assert told(robot, "read", "grip")


def test_a_fixed_joint_follows_nothing(tmp_path):
    robot = imported(tmp_path, finger('<mimic joint="wrist"/>', "fixed")).description
    assert not robot.structure.mimic_joints


@pytest.mark.parametrize(
    ("mimic", "said"),
    [
        ('<mimic joint="wrst"/>', "'grip'.*'wrst'.*'wrist'"),
        ('<mimic joint="grip"/>', "'grip'.*itself"),
        ('<mimic joint="wrist" multiplier="nan"/>', "'grip'.*multiplier"),
    ],
)
def test_a_mimic_joint_of_nothing_is_an_error_that_names_it(tmp_path, mimic, said):
    with pytest.raises(DescriptionError, match=said):
        imported(tmp_path, finger(LIMIT + mimic))
