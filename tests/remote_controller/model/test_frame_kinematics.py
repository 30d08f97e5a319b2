"""A frame as seen from another one: placement and Jacobian, wherever the two are."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.arm3 import describe

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.robots import load

HOAP3, ARM = load("hoap3"), describe()
PAIRS = [
    (HOAP3, "r_forearm", "r_sole"),
    (HOAP3, "l_sole", "r_sole"),
    (HOAP3, "pelvis", "l_forearm"),
    (HOAP3, "r_sole", "pelvis"),
    (HOAP3, "l_forearm", "l_forearm"),
    (ARM, "hand", "base"),
    (ARM, "base", "tool"),
    (ARM, "forearm", "hand"),
]
NAMES = [f"{frame} from {reference}" for _, frame, reference in PAIRS]
EVERY_PAIR = pytest.mark.parametrize(("robot", "frame", "reference"), PAIRS, ids=NAMES)
SEEDS = st.integers(0, 2**32 - 1)
Seen = tuple[FloatArray, FloatArray, FloatArray]


@cache
def kinematics_of(name: str) -> Kinematics:
    return Kinematics(HOAP3 if name == HOAP3.name else ARM)


def posture(robot: RobotDescription, seed: int) -> FloatArray:
    return np.random.default_rng(seed).uniform(robot.lower, robot.upper)


def see(kinematics: Kinematics, frame: str, reference: str, q: FloatArray) -> Seen:
    """Position, rotation and Jacobian as fresh arrays."""
    out = np.full(3, np.nan), np.full((3, 3), np.nan), np.full((6, len(q)), np.nan)
    numbers = kinematics.frame_id(frame), kinematics.frame_id(reference)
    kinematics.update(q)
    kinematics.frame(*numbers, *out)
    return out


@EVERY_PAIR
@settings(max_examples=15)
@given(seed=SEEDS)
def test_pinocchio_agrees(robot, frame, reference, seed):
    kinematics, q = kinematics_of(robot.name), posture(robot, seed)
    position, rotation, jacobian = see(kinematics, frame, reference, q)
    model, order = kinematics.robot.model, kinematics.robot.order
    data, ordered = model.createData(), np.empty(robot.n)
    ordered[order] = q
    pin.computeJointJacobians(model, data, ordered)
    pin.updateFramePlacements(model, data)
    local = pin.ReferenceFrame.LOCAL
    of, to = kinematics.robot.frame_id(frame), kinematics.robot.frame_id(reference)
    relative = data.oMf[to].actInv(data.oMf[of])
    twist = pin.getFrameJacobian(model, data, of, local)
    twist = twist - relative.actionInverse @ pin.getFrameJacobian(model, data, to, local)
    turn = np.kron(np.eye(2), relative.rotation)
    np.testing.assert_allclose(position, relative.translation, rtol=0, atol=1e-13)
    np.testing.assert_allclose(rotation, relative.rotation, rtol=0, atol=1e-13)
    np.testing.assert_allclose(jacobian, (turn @ twist)[:, order], rtol=0, atol=1e-12)


def test_joints_that_carry_both_frames_do_nothing():
    kinematics = kinematics_of(HOAP3.name)
    *_, jacobian = see(kinematics, "r_forearm", "r_shoulder_link", posture(HOAP3, 3))
    moving = {name for i, name in enumerate(HOAP3.joint_names) if jacobian[:, i].any()}
    assert moving == {"r_shoulder_roll", "r_shoulder_yaw", "r_elbow"}
    *_, jacobian = see(kinematics, "pelvis", "pelvis", posture(HOAP3, 3))
    assert not jacobian.any()


def test_joints_stay_where_the_wire_has_them():
    order = np.random.default_rng(2).permutation(HOAP3.n)
    shuffled = HOAP3.model_copy(
        update={
            "joints": tuple(HOAP3.joints[i] for i in order),
            "postures": {"q0": tuple(HOAP3.initial_position[order])},
        }
    )
    q, pair = posture(HOAP3, 5), ("l_forearm", "r_sole")
    *placement, jacobian = see(kinematics_of(HOAP3.name), *pair, q)
    *placement_too, jacobian_too = see(Kinematics(shuffled), *pair, q[order])
    for mine, other in zip(placement, placement_too, strict=True):
        np.testing.assert_array_equal(other, mine)
    np.testing.assert_array_equal(jacobian_too, jacobian[:, order])


def test_what_it_wrote_stays_when_it_moves_on():
    kinematics = kinematics_of(HOAP3.name)
    first = see(kinematics, "r_forearm", "l_sole", posture(HOAP3, 1))
    kept = [array.copy() for array in first]
    see(kinematics, "r_forearm", "l_sole", posture(HOAP3, 2))
    for now, before in zip(first, kept, strict=True):
        np.testing.assert_array_equal(now, before)
