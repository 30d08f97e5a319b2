"""HOAP-3 against a table written here by hand, and against kinematics written here in numpy."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.robot_emulator.robots import load

# Joint, parent, child, origin [m], axis, allowable range [deg], average and peak torque [N m],
# encoder scale [1/deg]: Fujitsu's manual of 2004, tables 6.1-2, 6.3-1 and 6.5-1.
X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
O = (0, 0, 0)  # noqa: E741 (the origin)
R_SHOULDER, L_SHOULDER = (-0.035, -0.111, 0.125), (-0.035, 0.111, 0.125)
TYPE_2, TYPE_3 = (1.5, 3.0), (2.0, 4.5)  # the two motors
HAND_WRITTEN = [
    ("r_hip_yaw", "pelvis", "r_hip_yaw_link", (-0.035, -0.039, -0.055), Z, (-91, 31), TYPE_2, 209),
    ("r_hip_roll", "r_hip_yaw_link", "r_hip_roll_link", O, X, (-31, 21), TYPE_3, 209),
    ("r_hip_pitch", "r_hip_roll_link", "r_thigh", O, Y, (-82, 71), TYPE_2, -209),
    ("r_knee", "r_thigh", "r_shank", (0, 0, -0.105), Y, (-1, 130), TYPE_3, 209),
    ("r_ankle_pitch", "r_shank", "r_ankle", (0, 0, -0.105), Y, (-61, 61), TYPE_3, 209),
    ("r_ankle_roll", "r_ankle", "r_foot", O, X, (-25, 25), TYPE_2, -209),
    ("r_shoulder_pitch", "trunk", "r_shoulder_link", R_SHOULDER, Y, (-91, 151), TYPE_2, 209),
    ("r_shoulder_roll", "r_shoulder_link", "r_upper_arm", O, Z, (-96, 1), TYPE_2, 209),
    ("r_shoulder_yaw", "r_upper_arm", "r_elbow_link", (0.111, 0, 0), X, (-91, 91), TYPE_2, -209),
    ("r_elbow", "r_elbow_link", "r_forearm", O, Y, (-115, 1), TYPE_2, -209),
    ("l_hip_yaw", "pelvis", "l_hip_yaw_link", (-0.035, 0.039, -0.055), Z, (-31, 91), TYPE_2, 209),
    ("l_hip_roll", "l_hip_yaw_link", "l_hip_roll_link", O, X, (-21, 31), TYPE_3, 209),
    ("l_hip_pitch", "l_hip_roll_link", "l_thigh", O, Y, (-82, 71), TYPE_2, 209),
    ("l_knee", "l_thigh", "l_shank", (0, 0, -0.105), Y, (-1, 130), TYPE_3, -209),
    ("l_ankle_pitch", "l_shank", "l_ankle", (0, 0, -0.105), Y, (-61, 61), TYPE_3, -209),
    ("l_ankle_roll", "l_ankle", "l_foot", O, X, (-25, 25), TYPE_2, -209),
    ("l_shoulder_pitch", "trunk", "l_shoulder_link", L_SHOULDER, Y, (-91, 151), TYPE_2, -209),
    ("l_shoulder_roll", "l_shoulder_link", "l_upper_arm", O, Z, (-1, 96), TYPE_2, 209),
    ("l_shoulder_yaw", "l_upper_arm", "l_elbow_link", (0.111, 0, 0), X, (-91, 91), TYPE_2, -209),
    ("l_elbow", "l_elbow_link", "l_forearm", O, Y, (-115, 1), TYPE_2, 209),
    ("waist_pitch", "pelvis", "trunk", O, Y, (-1, 90), TYPE_3, 209),
]

HOAP3 = load("hoap3")
MODEL = build_model(HOAP3)
ROOT = ET.fromstring(HOAP3.urdf)
INERTIALS = {link.get("name"): link.find("inertial") for link in ROOT.findall("link")}


def numbers(element: ET.Element, attribute: str) -> np.ndarray:
    return np.array([float(word) for word in element.get(attribute).split()])


def by_pinocchio(model, q: np.ndarray) -> tuple[np.ndarray, pin.SE3, pin.SE3]:
    """Centre of mass with the root, and both soles, in the root link's frame."""
    q_pinocchio = np.empty(model.model.nq)
    q_pinocchio[model.order] = q
    pin.framesForwardKinematics(model.model, model.data, q_pinocchio)
    moving = pin.centerOfMass(model.model, model.data, q_pinocchio)
    moving_mass = model.total_mass - model.root_mass
    com = (moving_mass * moving + model.root_mass * model.root_com) / model.total_mass
    soles = [model.data.oMf[model.frame_id(f"{side}_sole")].copy() for side in "rl"]
    return com, soles[0], soles[1]


def test_joints_are_fujitsus_in_fujitsus_order():
    assert HOAP3.n == 21
    assert HOAP3.joint_names == tuple(row[0] for row in HAND_WRITTEN)
    elements = {joint.get("name"): joint for joint in ROOT.findall("joint")}
    for name, parent, child, origin, axis, _range, _torque, _scale in HAND_WRITTEN:
        element = elements[name]
        assert element.get("type") == "revolute"
        assert element.find("parent").get("link") == parent
        assert element.find("child").get("link") == child
        assert numbers(element.find("axis"), "xyz").tolist() == list(axis)
        assert numbers(element.find("origin"), "xyz").tolist() == list(origin)
        assert element.find("origin").get("rpy") is None


def test_limits_are_fujitsus():
    hard = np.radians([row[5] for row in HAND_WRITTEN])
    usable = np.radians([(row[5][0] + 1, row[5][1] - 1) for row in HAND_WRITTEN])
    np.testing.assert_array_equal(np.c_[HOAP3.lower_hard, HOAP3.upper_hard], hard)
    np.testing.assert_array_equal(np.c_[HOAP3.lower, HOAP3.upper], usable)
    np.testing.assert_array_equal(HOAP3.velocity, np.full(21, 4.76))
    assert [joint.effort_average for joint in HOAP3.joints] == [row[6][0] for row in HAND_WRITTEN]
    assert HOAP3.effort.tolist() == [row[6][1] for row in HAND_WRITTEN]


def test_firmware_ceiling_is_57_counts_per_ms():
    np.testing.assert_allclose(HOAP3.velocity, 57e3 / np.abs(HOAP3.counts_per_rad), rtol=1e-4)


def test_encoders_have_209_signed_counts_per_degree():
    scales = [row[7] for row in HAND_WRITTEN]
    np.testing.assert_allclose(HOAP3.counts_per_rad * np.pi / 180, scales, rtol=1e-15)
    turn = np.abs(HOAP3.counts_per_rad) * 2 * np.pi
    np.testing.assert_allclose(turn, 75240, rtol=1e-15)
    reach = np.abs(HOAP3.counts_per_rad) * np.maximum(-HOAP3.lower_hard, HOAP3.upper_hard)
    assert reach.max() < 2**15, "every position fits into the robot's int16 counts"


def test_the_rest_of_the_description():
    assert HOAP3.name == "hoap3"
    assert HOAP3.period_s == 0.001
    assert HOAP3.base_frame == "r_sole"
    assert HOAP3.initial_posture == "q0"
    assert set(HOAP3.postures) == {"q0", "q0_arms_forward", "walk_ready", "zero"}
    assert [sole.frame for sole in HOAP3.soles] == ["r_sole", "l_sole"]
    for sole in HOAP3.soles:
        corners = np.array(sole.polygon)
        np.testing.assert_allclose(np.ptp(corners, axis=0), [0.108, 0.073], atol=1e-15)
        np.testing.assert_allclose(corners.mean(axis=0), 0.0, atol=1e-15)


def test_walk_ready_is_the_recorded_one():
    leg = [0, 0.191, -17.679, 45.632, -27.785, 1.598]
    other_leg = [0, 0.191, -17.847, 45.632, -27.785, -2.033]
    recorded = [*leg, 90, -9.569, 0, -42.105, *other_leg, 90, 9.569, 0, -42.105, 2]
    np.testing.assert_array_equal(HOAP3.postures["walk_ready"], np.radians(recorded))


def test_mass_is_that_of_the_sheet():
    by_hand = sum(
        float(inertial.find("mass").get("value"))
        for inertial in INERTIALS.values()
        if inertial is not None
    )
    assert by_hand == pytest.approx(8.8024, rel=0, abs=1e-12)
    assert MODEL.total_mass == pytest.approx(8.8024, rel=0, abs=1e-12)
    assert MODEL.root_mass == 0.417
    np.testing.assert_array_equal(MODEL.root_com, [-0.0322707, 0.000329172, 0.0111375])


@pytest.mark.parametrize("posture", ["q0", "q0_arms_forward"])
def test_centre_of_mass_starts_where_the_paper_says(posture):
    com, right, left = by_pinocchio(MODEL, np.array(HOAP3.postures[posture]))
    np.testing.assert_allclose(right.actInv(com), [-0.0085, 0.0279, 0.2869], rtol=0, atol=1e-9)
    between = right.inverse() * left
    np.testing.assert_allclose(between.translation, [0, 0.088, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(between.rotation, np.eye(3), rtol=0, atol=1e-9)
    np.testing.assert_allclose(right.rotation, np.eye(3), rtol=0, atol=1e-9)
