"""What newer versions of URDF, dialects and exporters write: used, or named and counted."""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import yaml
from support.urdfs.vendor_arm import (
    INERTIAL,
    JOINTS,
    LIMIT,
    LINKS,
    PACKAGE,
    joint,
    link,
    urdf,
    vendor_folder,
)

from hoap3.protocol.errors import ConfigError, DescriptionError
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.robots.urdf_import.folder import write_folder
from hoap3.robot_emulator.robots.urdf_import.imported import ImportedRobot, import_robot
from hoap3.tools.robots.robot_facts import look

TURN = 'quat_xyzw="0 0 0.70710678 0.70710678"'  # 90° about z
CYLINDER = '<geometry><cylinder radius="0.02" length="0.5"/></geometry>'


def imported(at, text: str) -> ImportedRobot:
    return import_robot(vendor_folder(at, text))


def said(robot: ImportedRobot) -> str:
    return "\n".join(note.line() for note in robot.notes)


def elbow_with(limit: str) -> str:
    """The URDF with this <limit> at the elbow, and what else stands beside it."""
    return urdf(
        joints=joint("shoulder", "base", "upper") + joint("elbow", "upper", "fore", limit),
        links=link("base") + link("upper") + link("fore"),
    )


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ('<origin xyz="0 0 0.3"/>', f'<origin xyz="0 0 0.3" {TURN}/>', "joint/origin"),
        ('<origin xyz="0 0 0.1"/>', f'<origin xyz="0 0 0.1" {TURN}/>', "link/inertial/origin"),
        (
            '<link name="fore">',
            f'<link name="fore"><collision><origin {TURN}/>{CYLINDER}</collision>',
            "link[@name='fore']/collision/origin",
        ),
        (
            '<link name="fore">',
            f'<link name="fore"><visual><origin {TURN}/>{CYLINDER}</visual>',
            "link/visual/origin",
        ),
    ],
)
def test_a_quaternion_turns_as_roll_pitch_and_yaw_do(tmp_path, old, new, where):
    text = urdf()
    assert old in text
    robot = imported(tmp_path, text.replace(old, new)).description
    turned = [each for each in ET.fromstring(robot.urdf).findall(where) if each.get("rpy")]
    assert turned
    for origin in turned:
        found = [float(word) for word in origin.get("rpy", "").split()]
        np.testing.assert_allclose(found, [0.0, 0.0, math.pi / 2], atol=1e-7)


def test_a_quaternion_turns_a_mesh(tmp_path):
    geometry = '<visual><geometry><mesh filename="package://acme_description/meshes/upper.stl"'
    text = urdf().replace(geometry, geometry.replace("<visual>", f"<visual><origin {TURN}/>"))
    (visual,) = [each for each in imported(tmp_path, text).parts.visuals if each.link == "upper"]
    np.testing.assert_allclose(visual.rpy, [0.0, 0.0, math.pi / 2], atol=1e-7)


@pytest.mark.parametrize("turn", ['quat_xyzw="0 0 0 0"', f'rpy="0 0 0" {TURN}', 'quat_xyzw="1 0"'])
def test_a_quaternion_that_is_none_is_refused(tmp_path, turn):
    text = urdf().replace('xyz="0 0 0.3"', f'xyz="0 0 0.3" {turn}', 1)
    with pytest.raises(DescriptionError, match=r"'shoulder'.*quat_xyzw"):
        imported(tmp_path, text)


DRAKE = '<robot xmlns:drake="http://drake.mit.edu"'
RATES = {
    "1.2": ('acceleration="2" deceleration="3" jerk="20"', (2.0, 3.0, 20.0)),
    "acceleration alone": ('acceleration="2"', (2.0, 2.0, math.inf)),
    "drake": ('drake:acceleration="2" drake:jerk="20"', (2.0, 2.0, 20.0)),
    "jerk alone": ('jerk="20"', (500.0, 20.0, 20.0)),
    "placeholders": ('acceleration="1e9" deceleration="-1" jerk="0"', (500.0, 20.0, math.inf)),
}


@pytest.mark.parametrize("case", RATES)
def test_accelerations_and_jerk_of_a_limit_are_used(tmp_path, case):
    more, expected = RATES[case]
    text = elbow_with(LIMIT.replace("/>", f" {more}/>")).replace("<robot", DRAKE, 1)
    robot = imported(tmp_path, text)
    for each in (robot.description, load(write_folder(robot, tmp_path / "made")[0])):
        elbow = each.joints[1]
        found = elbow.setpoint_acceleration_max, elbow.brake_acceleration, elbow.setpoint_jerk_max
        assert found == expected
    entry = yaml.safe_load((tmp_path / "made" / "robot.yaml").read_text())["joints"][1]
    assert ("acceleration" in entry.get("guessed", [])) == (expected[0] == 500.0)
    assert ("elbow (1e+09)" in said(robot)) == (case == "placeholders")


def test_the_braking_of_franka_is_used_and_its_offset_counted(tmp_path):
    braking = '<position_based_velocity_limits velocity_offset="0.3" deceleration_limit="6"/>'
    robot = imported(tmp_path, elbow_with(LIMIT + braking))
    assert robot.description.joints[1].brake_acceleration == 6.0
    assert "1 velocity_offset of <position_based_velocity_limits>" in said(robot)


SOFT = '<safety_controller soft_lower_limit="-0.5" soft_upper_limit="0.5" k_velocity="10"/>'


@pytest.mark.parametrize(
    "given", ['hard_lower="-9" hard_upper="9"', 'hard_upper="9"', 'hard_lower="abc"']
)
def test_a_vendors_attribute_does_not_become_a_stop(tmp_path, given):
    joints = JOINTS.replace(LIMIT, LIMIT.replace("/>", f" {given}/>"))
    robot, plain = imported(tmp_path / "a", urdf(joints=joints)), imported(tmp_path / "b", urdf())
    assert robot.description.joints == plain.description.joints
    assert "hard_" in said(robot)


def test_soft_limits_are_the_usable_range_between_the_stops(tmp_path):
    robot = imported(tmp_path, elbow_with(LIMIT + SOFT))
    for each in (robot.description, load(write_folder(robot, tmp_path / "made")[0])):
        elbow = each.joints[1]
        assert (elbow.lower, elbow.upper) == (-0.5, 0.5)
        assert (elbow.lower_hard, elbow.upper_hard) == (-2.0, 2.5)
    assert "1 k_velocity of <safety_controller>" in said(robot)


@pytest.mark.parametrize("given", ["", LIMIT.replace("lower", "least").replace("upper", "most")])
def test_soft_limits_hold_where_there_are_no_stops(tmp_path, given):
    elbow = imported(tmp_path, elbow_with(given + SOFT)).description.joints[1]
    assert (elbow.lower, elbow.upper) == (-0.5, 0.5)
    assert (elbow.lower_hard, elbow.upper_hard) == (-0.5, 0.5)


@pytest.mark.parametrize(
    ("limits", "kind"),
    [('soft_lower_limit="3" soft_upper_limit="4"', "revolute"),
     ('soft_lower_limit="-1" soft_upper_limit="1"', "continuous")],
)  # fmt: skip
def test_soft_limits_of_no_use_are_named(tmp_path, limits, kind):
    text = elbow_with(f"{LIMIT}<safety_controller {limits}/>")
    text = text.replace('"elbow" type="revolute"', f'"elbow" type="{kind}"')
    robot = imported(tmp_path, text)
    assert robot.description.joints[1].upper in {2.5, math.inf}
    assert "soft limits" in said(robot)
    assert "elbow" in said(robot)


def test_what_is_given_twice_is_named_and_the_first_holds(tmp_path):
    second = '<limit lower="-0.1" upper="0.1" velocity="0.1" effort="1"/>'
    text = elbow_with(f'{LIMIT}{second}<axis xyz="0 1 0"/><axis xyz="1 0 0"/>')
    two = CYLINDER.replace("</geometry>", '<box size="1 1 1"/></geometry>')
    shapes = f"{INERTIAL}{INERTIAL}<collision>{two}</collision>"
    robot = imported(tmp_path, text.replace(f'"fore">{INERTIAL}', f'"fore">{shapes}'))
    assert robot.description.upper[1] == 2.5
    for name in ("1 <limit> of joint 'elbow'", "1 <axis> of joint 'elbow'"):
        assert name in said(robot)
    for name in ("1 <inertial> of link 'fore'", "1 <box> of link 'fore'"):
        assert name in said(robot)


def test_attributes_and_elements_that_nobody_reads_are_counted(tmp_path):
    text = urdf(
        joints=JOINTS.replace(LIMIT, LIMIT.replace("/>", ' drake:stiffness="1" soft="2"/>')),
        links=LINKS.replace("<inertial>", '<inertial unit="g">'),
    ).replace("<robot", DRAKE, 1)
    text = text.replace("</robot>", "<transmission/><gazebo/><ros2_control/><gazebo/></robot>")
    found = said(imported(tmp_path, text))
    for each in (
        "3 stiffness of <limit>",
        "3 soft of <limit>",
        "4 unit of <inertial>",
        "1 <transmission>",
        "2 <gazebo>",
        "1 <ros2_control>",
    ):
        assert each in found


def test_check_counts_what_a_robot_of_ones_own_has_too_much(tmp_path):
    path = vendor_folder(tmp_path, elbow_with(LIMIT + SOFT))
    (path.parent / "robot.yaml").write_text("name: own\nurdf: arm.urdf\n")
    notes = "\n".join(look(str(path.parent)).notes)
    assert "1 <safety_controller>" in notes
    assert "1 k_velocity of <safety_controller>" in notes


@pytest.mark.parametrize("word", ["1_0", "\u0661\u0660", "1,5", "0x10", "nan", "1e", "ten"])
@pytest.mark.parametrize("old", ['lower="-2"', 'value="2"', 'xyz="0 0 0.3"'])
def test_only_numbers_of_the_format_are_numbers(tmp_path, word, old):
    key = old.partition("=")[0]
    new = f'{key}="0 0 {word}"' if key == "xyz" else f'{key}="{word}"'
    with pytest.raises(DescriptionError, match=rf"{key}.*{word}"):
        imported(tmp_path, urdf().replace(old, new, 1))


@pytest.mark.parametrize(
    ("old", "new", "velocity", "torques"),
    [
        ('velocity="2"', 'velocity="1e9"', 1.0, True),
        ('velocity="2"', 'velocity="-1"', 1.0, True),
        ('velocity="2"', 'velocity="1000"', 1.0, True),
        ('velocity="2"', 'velocity="0"', 1.0, True),
        ('velocity="2"', 'velocity="999"', 999.0, True),
        ('effort="30"', 'effort="1e9"', 2.0, False),
        ('effort="30"', 'effort="-1"', 2.0, False),
        ('effort="30"', 'effort="0"', 2.0, False),
    ],
)
def test_placeholders_are_treated_as_missing(tmp_path, old, new, velocity, torques):
    robot = imported(tmp_path, elbow_with(LIMIT.replace(old, new)))
    assert robot.description.joints[1].velocity == velocity
    assert ("torque" in robot.description.command_kinds) == torques
    given = new.split('"')[1]
    assert ("plausible: elbow" in said(robot)) == (given not in {"0", "999"})


HINTS = {
    "degrees": ('lower="-2" upper="2.5"', 'lower="-170" upper="170"', "degrees: elbow (-170)"),
    "degrees per second": ('velocity="2"', 'velocity="180"', "degrees: elbow (180)"),
    "length": ('xyz="0 0 0.3"', 'xyz="400 0 0"', "millimetres: joint shoulder"),
    "size": ("</link>", '<visual><geometry><box size="1 200 1"/></geometry></visual></link>',
             "millimetres: link base"),
    "mass": ('mass value="2"', 'mass value="1500"', "kg m²: base (1500 kg"),
    "inertia": ('ixx="0.02"', 'ixx="2e4"', "kg m²: base (2 kg, 20000 kg m²)"),
}  # fmt: skip


@pytest.mark.parametrize("case", HINTS)
def test_figures_that_may_be_in_another_unit_are_named(tmp_path, case):
    old, new, hint = HINTS[case]
    text = elbow_with(LIMIT)
    place = text.rindex(old) if case.startswith("degrees") else text.index(old)
    robot = imported(tmp_path, text[:place] + new + text[place + len(old) :])
    assert hint in said(robot)
    assert hint not in said(imported(tmp_path, text))


def test_a_slider_of_400_m_is_named(tmp_path):
    text = elbow_with('<limit lower="0" upper="400" velocity="100" effort="4"/>')
    text = text.replace('"elbow" type="revolute"', '"elbow" type="prismatic"')
    assert "millimetres: elbow (400)" in said(imported(tmp_path, text))


@pytest.mark.parametrize("ends", [("1", "0"), ("0", "-1")])
def test_limits_that_mean_none_to_bullet_are_none(tmp_path, ends):
    limit = LIMIT.replace('"-2"', f'"{ends[0]}"').replace('"2.5"', f'"{ends[1]}"')
    robot = imported(tmp_path, elbow_with(limit))
    assert math.isinf(robot.description.upper[1])
    assert "Bullet" in said(robot)


def test_a_default_namespace_is_named_and_no_obstacle(tmp_path):
    text = urdf().replace("<robot ", '<robot xmlns="http://example.org/ns" ')
    robot = imported(tmp_path, text)
    assert robot.description.urdf == imported(tmp_path, urdf()).description.urdf
    assert "1 xmlns of <robot>" in said(robot)


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        ("<!-- a licence -->\n" + urdf(), "XML"),
        (urdf().replace("<limit", '<limit drake:jerk="1"', 1), "xmlns:drake"),
        (urdf().replace('xyz="0 0 0.3"', 'xyz="$(optenv X 0 0 0)"'), "xacro"),
    ],
)
def test_errors_of_the_format_name_the_cause(tmp_path, text, remedy):
    with pytest.raises(DescriptionError, match=remedy):
        imported(tmp_path, text)


def test_another_version_is_named(tmp_path):
    assert "2.0" in said(imported(tmp_path, urdf().replace("<robot", '<robot version="2.0"', 1)))


LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"


def test_a_pointer_of_git_lfs_is_called_so(tmp_path):
    with pytest.raises(ConfigError, match="Git LFS"):
        load(vendor_folder(tmp_path, LFS))


@pytest.mark.parametrize("content", [LFS, b"", b"<!DOCTYPE html><html>404</html>"])
def test_a_mesh_that_is_none_is_named(tmp_path, content):
    path = vendor_folder(tmp_path)
    (tmp_path / PACKAGE / "meshes" / "upper.stl").write_bytes(content)
    robot = import_robot(path)
    assert [each.link for each in robot.parts.visuals] == ["base"]
    assert said(robot).count("meshes/upper.stl") == 2  # to draw, and to collide
    with pytest.raises(DescriptionError, match=r"upper\.stl"):
        import_robot(path, strict=True)


DAE = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"
 version="1.4.1"><asset><unit name="u" meter="{unit}"/><up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="pa" count="24">{points}
</float_array><technique_common><accessor source="#pa" count="8" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor></technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/>
</vertices><triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 3 0 3 2 4 6
 7 4 7 5 0 4 5 0 5 1 2 3 7 2 7 6 0 2 6 0 6 4 1 5 7 1 7 3</p></triangles></mesh></geometry>
</library_geometries><library_visual_scenes><visual_scene id="s"><node id="n">
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


@pytest.mark.parametrize("unit", [1.0, 1e-3, 0.0254])
@pytest.mark.parametrize("up", ["Z_UP", "Y_UP"])
def test_the_unit_of_a_collada_file_is_used(tmp_path, unit, up):
    path = vendor_folder(tmp_path, urdf().replace("upper.stl", "upper.dae"))
    corners = [(x, y, z) for x in (0.0, 0.1) for y in (0.0, 0.2) for z in (0.0, 0.3)]
    points = " ".join(f"{value / unit:.9g}" for corner in corners for value in corner)
    mesh = tmp_path / PACKAGE / "meshes" / "upper.dae"
    mesh.write_text(DAE.format(unit=unit, up=up, points=points))
    robot = import_robot(path)
    (box,) = ET.fromstring(robot.description.urdf).iterfind("link[@name='upper']//box")
    size = sorted(float(word) for word in box.get("size", "").split())
    np.testing.assert_allclose(size, [0.1, 0.2, 0.3], atol=1e-5)
    (visual,) = [each for each in robot.parts.visuals if each.link == "upper"]
    np.testing.assert_allclose(visual.scale, unit)
    assert ("<up_axis> Y_UP" in said(robot)) == (up == "Y_UP")


def test_a_unit_that_is_no_length_is_named(tmp_path):
    path = vendor_folder(tmp_path, urdf().replace("upper.stl", "upper.dae"))
    mesh = tmp_path / PACKAGE / "meshes" / "upper.dae"
    mesh.write_text(DAE.format(unit="0", up="Z_UP", points="0 " * 24))
    assert re.search("<unit meter>.*'0'", said(import_robot(path)))
