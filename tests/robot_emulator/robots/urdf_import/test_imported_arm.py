"""What becomes of a vendor's arm: joints, limits, shapes, and what is said of it."""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.urdfs.vendor_arm import INERTIAL, JOINTS, LINKS, joint, link, urdf, vendor_folder

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.robots.urdf_import.imported import ImportedRobot, import_robot


def imported(tmp_path, text: str = "", **options) -> ImportedRobot:
    return import_robot(vendor_folder(tmp_path, text), **options)


def told(robot: ImportedRobot, about: str, name: str) -> list[str]:
    """Texts of the notes of a kind that hold for a name."""
    return [note.text for note in robot.notes if note.about == about and name in note.names]


def shapes(robot: RobotDescription, name: str) -> list[str]:
    found = ET.fromstring(robot.urdf).iterfind(f"link[@name='{name}']/collision/geometry/*")
    return [shape.tag for shape in found]


def test_what_the_file_says_is_kept(tmp_path):
    robot = imported(tmp_path).description
    assert robot.name == "acme_arm"
    assert robot.joint_names == ("shoulder", "elbow", "wrist")
    assert robot.lower.tolist() == [-2.0] * 3
    assert robot.upper.tolist() == [2.5] * 3
    assert robot.effort.tolist() == [30.0] * 3
    assert robot.setpoint_acceleration_max.tolist() == [500.0] * 3  # as any robot.yaml has it
    assert robot.command_kinds == ("position", "acceleration", "torque")
    assert robot.structure.root == robot.base_frame == "base"


def test_what_travels_names_no_file_and_comes_back_from_the_wire(tmp_path):
    robot = imported(tmp_path).description
    for word in ("mesh", "://", str(tmp_path), "acme_description"):
        assert word not in robot.urdf
    assert RobotDescription.from_json(robot.to_json()).digest == robot.digest


def test_a_collision_mesh_becomes_the_shape_that_fits_it(tmp_path):
    robot = imported(tmp_path)
    assert shapes(robot.description, "base") == ["box"]
    assert shapes(robot.description, "upper") == ["cylinder", "sphere", "sphere"]  # a capsule
    assert told(robot, "read", "upper")


@pytest.mark.parametrize("rpy", [(0.3, -0.8, 2.0), (0.4, math.pi / 2, -0.7)], ids=str)
def test_the_box_of_a_turned_mesh_is_around_its_vertices(tmp_path, rpy):
    """Roll, pitch and yaw of the box are its own; the second is where yaw and roll turn alike."""
    origin = f'<origin xyz="0.1 0 0.2" rpy="{rpy[0]} {rpy[1]} {rpy[2]}"/>'
    text = urdf().replace("<collision>", f"<collision>{origin}", 1)
    found = ET.fromstring(imported(tmp_path, text).description.urdf).find("link/collision")
    xyz, own = (np.array(found.find("origin").get(key).split(), float) for key in ("xyz", "rpy"))
    size = np.array(found.find("geometry/box").get("size").split(), float)
    corners = np.array(np.meshgrid([-0.1, 0.1], [-0.2, 0.2], [0.0, 0.05])).reshape(3, -1).T
    vertices = Rotation.from_euler("xyz", rpy).apply(corners) + np.array([0.1, 0.0, 0.2])
    inside = Rotation.from_euler("xyz", own).inv().apply(vertices - xyz)
    assert (np.abs(inside) <= size / 2).all()
    np.testing.assert_allclose(sorted(size), (0.05, 0.2, 0.4), atol=1e-5)


def test_a_visual_mesh_stays_here_and_is_known_by_its_digest(tmp_path):
    visuals = imported(tmp_path).parts.visuals
    assert [each.link for each in visuals] == ["base", "upper"]
    assert all(each.path.is_relative_to(tmp_path) and len(each.sha256) == 64 for each in visuals)


def test_the_axis_of_a_fixed_joint_is_no_matter(tmp_path):
    fixed = joint("tip", "hand", "tool", '<axis xyz="0 0 0"/>', "fixed")
    text = urdf(LINKS + link("tool"), JOINTS + fixed)
    assert imported(tmp_path, text).description.n == 3


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
def test_a_zero_axis_of_a_movable_joint_is_an_error_that_names_it(tmp_path, kind):
    text = urdf(
        joints=JOINTS.replace('name="elbow" type="revolute"', f'name="elbow" type="{kind}"')
    )
    text = text.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>')
    with pytest.raises(DescriptionError, match=r"'shoulder'.*axis"):
        imported(tmp_path, text)


GUESSES = {
    "no limit": ("", "revolute", (-math.inf, math.inf, 1.0)),
    "zeros": ('<limit lower="0" upper="0" velocity="0" effort="0"/>', "revolute", None),
    "no range": ('<limit velocity="0" effort="4"/>', "revolute", None),
    "endless": ('<limit lower="-1e16" upper="1e16" velocity="0" effort="4"/>', "revolute", None),
    "no velocity": ('<limit lower="-1" upper="1"/>', "revolute", (-1.0, 1.0, 1.0)),
    "infinite": ('<limit lower="-1" upper="1" velocity="inf"/>', "revolute", (-1.0, 1.0, 1.0)),
    "slider": ('<limit lower="-1" upper="1"/>', "prismatic", (-1.0, 1.0, 0.1)),
    "turns": ("", "continuous", (-math.inf, math.inf, 1.0)),
}


@pytest.mark.parametrize("case", GUESSES)
def test_missing_figures_get_their_defaults_and_each_is_said(tmp_path, case):
    inside, kind, expected = GUESSES[case]
    joints = joint("shoulder", "base", "upper") + joint("elbow", "upper", "fore", inside, kind)
    text = urdf(link("base") + link("upper") + link("fore"), joints)
    robot = imported(tmp_path, text)
    known, elbow = robot.description.joints
    lower, upper, velocity = expected or (-math.inf, math.inf, 1.0)
    assert (elbow.lower, elbow.upper, elbow.velocity) == (lower, upper, velocity)
    assert elbow.setpoint_acceleration_max == elbow.brake_acceleration == velocity / 0.2
    assert known.setpoint_acceleration_max == 500.0
    said = told(robot, "guessed", "elbow")
    assert any("velocity" in text for text in said)
    assert any("0.2 s" in text for text in said)
    assert any("without end" in text for text in said) == (math.isinf(lower) and kind == "revolute")
    (only,) = told(robot, "guessed", "shoulder")  # its velocity is given, and no acceleration
    assert "250/s" in only


def test_half_a_range_has_its_other_end_at_zero_as_the_format_says(tmp_path):
    text = urdf(joints=JOINTS.replace('lower="-2" ', ""))
    assert imported(tmp_path, text).description.lower.tolist() == [0.0] * 3


@pytest.mark.parametrize(
    ("lower", "upper", "kept"),
    [
        ("-1.5", "1e5", (-1.5, 1e4)),
        ("-inf", "0.5", (-1e4, 0.5)),
        ("2", "1e16", (2.0, 1e4)),
    ],
)
def test_a_stop_is_kept_where_only_the_other_one_is_endless(tmp_path, lower, upper, kept):
    limit = f'<limit lower="{lower}" upper="{upper}" velocity="1" effort="4"/>'
    text = urdf(LINKS + link("tool"), JOINTS + joint("extra", "base", "tool", limit))
    robot = imported(tmp_path, text)
    assert (robot.description.lower[3], robot.description.upper[3]) == kept
    assert robot.description.structure.moved["extra"].kind == "revolute"
    assert told(robot, "guessed", "extra")


def test_without_effort_no_torques_are_taken(tmp_path):
    robot = imported(tmp_path, urdf(joints=JOINTS.replace(' effort="30"', "", 1)))
    assert robot.description.command_kinds == ("position", "acceleration")
    assert robot.description.effort.tolist() == [math.inf, 30.0, 30.0]
    assert told(robot, "left out", "shoulder")
    again = RobotDescription.from_json(robot.description.to_json())
    assert again.effort.tolist() == robot.description.effort.tolist()
    with pytest.raises(DescriptionError, match=r"'shoulder'.*effort"):
        robot.description.model_copy(update={"command_kinds": ("torque",)})


def test_where_nothing_weighs_only_positions_are_taken(tmp_path):
    robot = imported(tmp_path, urdf(LINKS.replace(INERTIAL, "")))
    assert robot.description.command_kinds == ("position",)
    assert any("mass" in note.text for note in robot.notes)
    assert robot.description.default_task is not None


def test_where_a_joint_moves_nothing_that_weighs_only_positions_are_taken(tmp_path):
    robot = imported(tmp_path, urdf(LINKS.replace(link("hand"), '<link name="hand"/>')))
    assert robot.description.command_kinds == ("position",)
    assert told(robot, "read", "hand") == ["links that move and weigh nothing"]


def test_where_a_joint_moves_more_than_a_number_holds_only_positions_are_taken(tmp_path):
    heavy = LINKS.replace('xyz="0 0 0.1"', 'xyz="0 0 1e200"')
    robot = import_robot(vendor_folder(tmp_path, urdf(heavy))).description
    assert robot.command_kinds == ("position",)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('izz="0.01"', 'izz="0.5"', True),
        ('ixx="0.02"', 'ixx="-0.02"', True),
        ('izz="0.01"', 'izz="0.04"', False),  # 0.02 + 0.02: a flat body
        ('mass value="2"', 'mass value="0"', True),
    ],
)
def test_an_inertia_that_no_body_can_have_is_said(tmp_path, old, new, said):
    text = urdf(LINKS.replace(link("fore"), link("fore", inertial=INERTIAL.replace(old, new))))
    assert bool(told(imported(tmp_path, text), "read", "fore")) == said


def test_half_an_inertial_is_left_out(tmp_path):
    text = urdf(LINKS.replace('<mass value="2"/>', "", 1))
    robot = imported(tmp_path, text)
    assert told(robot, "left out", "base")
    assert robot.description.structure.weighs


@pytest.mark.parametrize("kind", ["floating", "planar", "spherical"])
def test_a_free_base_is_welded(tmp_path, kind):
    free = joint("free", "world", "base", "", kind)
    robot = imported(tmp_path, urdf('<link name="world"/>' + LINKS, free + JOINTS))
    assert robot.description.joint_names == ("shoulder", "elbow", "wrist")
    assert robot.description.structure.root == "world"
    assert told(robot, "left out", "free")


def test_a_free_base_below_a_fixed_joint_is_welded_too(tmp_path):
    free = joint("free", "stand", "base", "", "floating") + joint(
        "s", "world", "stand", "", "fixed"
    )
    links = '<link name="world"/><link name="stand"/>' + LINKS
    assert imported(tmp_path, urdf(links, free + JOINTS)).description.n == 3


def test_a_free_joint_within_the_robot_is_an_error_that_names_it(tmp_path):
    free = joint("loose", "hand", "tool", "", "floating")
    with pytest.raises(DescriptionError, match=r"joint 'loose'.*floating"):
        imported(tmp_path, urdf(LINKS + link("tool"), JOINTS + free))


def test_joint_names_that_cannot_travel_are_replaced_and_said(tmp_path):
    text = urdf(joints=JOINTS.replace('"elbow"', '"left elbow (1)"'))
    robot = imported(tmp_path, text)
    assert robot.description.joint_names == ("shoulder", "left_elbow_1_", "wrist")
    assert any("renamed" in note.text for note in robot.notes)


@pytest.mark.parametrize(
    ("stated", "called"),
    [("UR5", "ur5"), ("2dof arm!", "robot_2dof_arm"), ("A" * 50, "a" * 32), ("日本", "robot")],
)
def test_the_robot_gets_a_name_for_the_network(tmp_path, stated, called):
    assert imported(tmp_path, urdf(name=stated)).description.name == called
    assert imported(tmp_path, urdf(name=stated), called="mine").description.name == "mine"


def test_the_start_is_zero_or_the_limit_nearest_to_it(tmp_path):
    joints = JOINTS.replace('lower="-2" upper="2.5"', 'lower="0.5" upper="2.5"', 1)
    robot = imported(tmp_path, urdf(joints=joints))
    assert robot.description.initial_position.tolist() == [0.5, 0.0, 0.0]
    assert any("shoulder at 0.5" in note.names for note in robot.notes)


def test_the_default_task_moves_the_tip_to_where_it_can_be(tmp_path):
    text = urdf(LINKS + link("finger"), JOINTS + joint("grip", "hand", "finger"))
    task = imported(tmp_path, text).description.default_task
    assert task is not None
    assert (task.point, task.reference) == ("finger", "base")
    assert task.move_m is not None
    assert 0.04 < np.linalg.norm(task.move_m) <= 0.05 + 1e-6


def test_a_robot_of_which_no_joint_moves_the_tip_has_no_default_task(tmp_path):
    text = urdf(link("base") + link("rotor"), joint("spin", "base", "rotor"))
    robot = imported(tmp_path, text)
    assert robot.description.default_task is None


def test_where_nothing_weighs_there_is_no_centre_of_mass(tmp_path):
    robot = imported(tmp_path, urdf(LINKS.replace(INERTIAL, ""))).description
    task = robot.default_task.model_copy(update={"point": "com"})
    with pytest.raises(DescriptionError, match="mass"):
        robot.model_copy(update={"default_task": task})
    with pytest.raises(DescriptionError, match="mass"):
        robot.model_copy(update={"command_kinds": ("acceleration",)})
