"""The URDF reader: what it finds, and what it refuses before anything can be harmed by it."""

from __future__ import annotations

import re

import pytest
from support.arm3 import URDF

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.robot.urdf import MAX_BYTES, MimicJoint, read_urdf

BOX = '<box size="0.3 0.06 0.06"/>'
SHOULDER = '<joint name="shoulder" type="revolute">'
ELBOW = '<joint name="elbow" type="revolute">'
FIXED = '<joint name="tool_joint" type="fixed">'


def test_structure_keeps_the_order_of_the_text():
    arm = read_urdf(URDF)
    assert arm.links == ("base", "upper_arm", "forearm", "hand", "tool")
    assert tuple(arm.movable) == ("shoulder", "elbow", "wrist")
    assert arm.root == "base"
    assert arm.moving == {"upper_arm", "forearm", "hand", "tool"}
    elbow = arm.movable["elbow"]
    assert (elbow.parent, elbow.child) == ("upper_arm", "forearm")
    assert (elbow.lower, elbow.upper, elbow.velocity, elbow.effort) == (0.1, 2.4, 2.5, 12.0)


def test_a_continuous_joint_has_no_position_limits_whatever_its_limit_says():
    arm = read_urdf(URDF.replace(SHOULDER, SHOULDER.replace("revolute", "continuous")))
    turning = arm.movable["shoulder"]
    assert (turning.lower, turning.upper, turning.velocity, turning.effort) == (None, None, 2.0, 20)
    bare = re.sub(r"<limit [^>]*velocity=\"2.0\"[^>]*>", "", URDF)
    arm = read_urdf(bare.replace(SHOULDER, SHOULDER.replace("revolute", "continuous")))
    assert arm.movable["shoulder"].velocity is None


def test_a_chain_of_mimic_joints_has_one_mimicked_joint():
    """q_wrist = −2·q_elbow + 0.5 and q_elbow = 3·q_shoulder − 1."""
    text = URDF.replace(ELBOW, ELBOW + '<mimic joint="shoulder" multiplier="3" offset="-1"/>')
    wrist = '<joint name="wrist" type="revolute">'
    text = text.replace(wrist, wrist + '<mimic joint="elbow" multiplier="-2" offset="0.5"/>')
    arm = read_urdf(text)
    assert tuple(arm.movable) == ("shoulder",)
    assert tuple(arm.moved) == ("shoulder", "elbow", "wrist")
    assert arm.mimic_joints == {
        "elbow": MimicJoint("elbow", "shoulder", 3.0, -1.0),
        "wrist": MimicJoint("wrist", "shoulder", -6.0, 2.5),
    }
    assert arm.moving == read_urdf(URDF).moving


def test_a_mimic_joint_has_ratio_1_and_no_offset_unless_it_says_so():
    arm = read_urdf(URDF.replace(ELBOW, ELBOW + '<mimic joint="wrist"/>'))
    assert arm.mimic_joints == {"elbow": MimicJoint("elbow", "wrist", 1.0, 0.0)}


def test_joints_that_follow_each_other_in_a_ring_are_refused():
    text = URDF.replace(ELBOW, ELBOW + '<mimic joint="shoulder"/>')
    text = text.replace(SHOULDER, SHOULDER + '<mimic joint="elbow"/>')
    with pytest.raises(DescriptionError, match="shoulder → elbow → shoulder"):
        read_urdf(text)


def test_a_chain_that_no_number_can_hold_is_refused():
    text = URDF.replace(ELBOW, ELBOW + '<mimic joint="shoulder" multiplier="1e200"/>')
    wrist = '<joint name="wrist" type="revolute">'
    text = text.replace(wrist, wrist + '<mimic joint="elbow" multiplier="1e200"/>')
    with pytest.raises(DescriptionError, match=r"'wrist'.*'shoulder'.*inf"):
        read_urdf(text)


def test_other_elements_are_ignored():
    text = URDF.replace("</robot>", '<gazebo reference="hand"><mu1>0.2</mu1></gazebo></robot>')
    assert read_urdf(text) == read_urdf(URDF)


LOOP = (
    '<link name="a"/><link name="b"/>'
    '<joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>'
    '<joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint>'
)
REFUSED = {
    "floating": (SHOULDER, SHOULDER.replace("revolute", "floating"), "'shoulder'.*'floating'"),
    "planar": (SHOULDER, SHOULDER.replace("revolute", "planar"), "'shoulder'.*'planar'.*prismatic"),
    "misspelt type": (SHOULDER, SHOULDER.replace("revolute", "revolut"), "'revolut'.*revolute"),
    "mimic without a joint": (SHOULDER, SHOULDER + "<mimic/>", "'shoulder'.*<mimic joint"),
    "mimic of a misspelt joint": (SHOULDER, SHOULDER + '<mimic joint="elbw"/>', "'elbw'.*'elbow'"),
    "mimic of a fixed joint": (SHOULDER, SHOULDER + '<mimic joint="tool_joint"/>', "'tool_joint'"),
    "mimic of itself": (SHOULDER, SHOULDER + '<mimic joint="shoulder"/>', "'shoulder'.*<mimic>"),
    "fixed mimic": (FIXED, FIXED + '<mimic joint="elbow"/>', "'tool_joint'.*<mimic>"),
    "mimic that stands": (
        SHOULDER,
        SHOULDER + '<mimic joint="elbow" multiplier="0" offset="0.5"/>',
        "'shoulder'.*multiplier.*<origin>.*0.5",
    ),
    "mesh": (BOX, '<mesh filename="/etc/passwd"/>', "<mesh>.*box, cylinder, sphere"),
    "texture": (
        "<visual>",
        '<visual><material name="m"><texture filename="x.png"/></material>',
        "<texture>",
    ),
    "capsule": (BOX, '<capsule radius="1" length="1"/>', "<capsule>.*box"),
    "doctype": ("<robot", '<!DOCTYPE robot [<!ENTITY a "b">]><robot', "<!DOCTYPE"),
    "entity": ("<robot", '<!ENTITY a "b"><robot', "<!ENTITY"),
    "not well-formed": ("</robot>", "", "line 61"),
    "other root": ("robot", "html", "<html>.*<robot"),
    "sdf": ("robot", "sdf", "SDF"),
    "mjcf": ("robot", "mujoco", "plant.parameters.mjcf"),
    "default namespace": ("<robot ", '<robot xmlns="http://example.org" ', "xmlns"),
    "quaternion": ('xyz="0 0 0.3"', 'quat_xyzw="0 0 0 1"', "quat_xyzw.*rpy"),
    "xacro expression": ('xyz="0 0 0.3"', 'xyz="$(arg x) 0 0"', "xyz.*xacro"),
    "arabic digits": ('mass value="2.0"', 'mass value="\u0662"', "'upper_arm'.*mass.*\u0662"),
    "not finite": ('xyz="0 0 0.3"', 'xyz="0 0 nan"', "'shoulder'.*xyz.*nan"),
    "too few": ('xyz="0 0 0.3"', 'xyz="0 0.3"', "'shoulder'.*xyz.*3 finite"),
    "underscore": ('mass value="2.0"', 'mass value="2_0"', "mass.*2_0"),
    "zero axis": ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', "'shoulder'.*<axis>"),
    "negative damping": (SHOULDER, SHOULDER + '<dynamics damping="-0.1"/>', "damping.*-0.1"),
    "negative friction": (SHOULDER, SHOULDER + '<dynamics friction="-1"/>', "friction.*-1"),
    "negative mass": ('mass value="2.0"', 'mass value="-2.0"', "'upper_arm'.*-2.0"),
    "no mass": ('<mass value="2.0"/>', "", "'upper_arm'.*<mass"),
    "incomplete inertia": ('ixx="0.002" ', "", "'upper_arm'.*<inertia>.*ixx"),
    "no limit": (
        '<limit lower="-2.5" upper="2.5" velocity="2.0" effort="20"/>',
        "",
        "'shoulder'.*<limit lower",
    ),
    "no such parent": ('<parent link="forearm"/>', '<parent link="forarm"/>', "'forarm'.*forearm'"),
    "loop beside the tree": ("</robot>", LOOP + "</robot>", "loop"),
    "no child": ('<child link="forearm"/>', "", "'elbow'.*<child link"),
    "two roots": ("</robot>", '<link name="other"/></robot>', "base, other"),
    "two parents": ('<child link="hand"/>', '<child link="forearm"/>', "'forearm'"),
    "same link": ('<link name="tool"/>', '<link name="tool"/><link name="tool"/>', "'tool'"),
    "same joint": ('name="elbow"', 'name="wrist"', "'wrist'"),
    "nameless": ('<link name="tool"/>', "<link/>", "<link>"),
    "reserved joint": ('name="elbow"', 'name="universe"', "'universe'"),
    "reserved link": ('"base"', '"universe"', "'universe'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusal_names_its_place(case):
    old, new, named = REFUSED[case]
    assert old in URDF
    with pytest.raises(DescriptionError, match=rf"^URDF.*{named}"):
        read_urdf(URDF.replace(old, new))


@pytest.mark.parametrize(
    "heavy",
    [
        '<link name="base">{}</link>',
        (
            '<link name="base"/><link name="box">{}</link>'
            '<joint name="j" type="fixed"><parent link="base"/><child link="box"/></joint>'
        ),
    ],
)
def test_mass_on_what_stands_still_makes_no_centre_of_mass_that_moves(heavy):
    inertial = (
        '<inertial><mass value="5"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    text = URDF.replace("inertial>", "ignored>").replace(
        '<link name="base"/>', heavy.format(inertial)
    )
    assert not read_urdf(text).weighs
    assert read_urdf(URDF).weighs


@pytest.mark.parametrize("text", ["", "<robot name='r'/>", "<robot><joint name='j'/></robot>"])
def test_a_urdf_without_links_is_told_to_have_none(text):
    with pytest.raises(DescriptionError, match="<link>" if text else None):
        read_urdf(text)


XACRO = '<xacro:property name="m" value="2"/><xacro:macro name="leg"/>'


@pytest.mark.parametrize(
    "declared", ["", ' xmlns:xacro="http://www.ros.org/wiki/xacro"', ' xmlns:xacro="http://xacro"']
)
def test_a_xacro_file_is_called_so(declared):
    text = re.sub("<robot([^>]*)>", rf"<robot\1{declared}>{XACRO}", URDF, count=1)
    text = re.sub('mass value="[^"]*"', 'mass value="${m}"', text)
    with pytest.raises(DescriptionError, match="xacro"):
        read_urdf(text)


def test_size_depth_and_number_of_links_are_bounded():
    with pytest.raises(DescriptionError, match=rf"{MAX_BYTES}"):
        read_urdf(URDF + " " * MAX_BYTES)
    with pytest.raises(DescriptionError, match="nested"):
        read_urdf("<robot>" + "<a>" * 100_000)
    crowd = "".join(
        f'<link name="x{i}"/><joint name="j{i}" type="fixed">'
        f'<parent link="tool"/><child link="x{i}"/></joint>'
        for i in range(1020)
    )
    with pytest.raises(DescriptionError, match="1025"):
        read_urdf(URDF.replace("</robot>", crowd + "</robot>"))


def test_a_declared_encoding_hides_nothing():
    text = URDF.replace('version="1.0"', 'version="1.0" encoding="utf-16"')
    assert read_urdf(text) == read_urdf(URDF)
