"""Algorithm 4 on robots with followers and continuous joints, against plain Pinocchio."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.arm3 import URDF, describe, joint
from support.robots.following_arm import following
from support.robots.following_trees import following_tree
from support.robots.full_model import FullModel

from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.remote_controller.bounds import torque_acceleration_bounds

LIMITS = {"lower": -2.0, "upper": 2.0}


@settings(max_examples=6)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 3), f=st.integers(1, 3))
def test_every_bound_is_what_the_effort_leaves_in_its_state(seed, n, f):
    robot = following_tree(seed, n, f)
    plain = FullModel(robot)
    found = torque_acceleration_bounds(build_model(robot), 10, polish=1, **LIMITS)
    for j in range(n):
        for sign, states, bounds in (
            (-1.0, found.lower_states, found.lower),
            (1.0, found.upper_states, found.upper),
        ):
            q, dq = states[j]
            h, M = plain.torques(q, dq, np.zeros(n)), plain.mass(q).diagonal()
            left = (sign * robot.effort[j] - h[j]) / M[j]
            assert bounds[j] == pytest.approx(left, rel=1e-9, abs=1e-9 * abs(h[j]) / M[j])
            assert np.all((q >= -2.0) & (q <= 2.0) & (np.abs(dq) <= robot.velocity))


def test_polishing_finds_no_better_states_than_there_were():
    robot = build_model(following())
    rough = torque_acceleration_bounds(robot, 20)
    fine = torque_acceleration_bounds(robot, 20, polish=1)
    assert np.all(fine.lower >= rough.lower)
    assert np.all(fine.upper <= rough.upper)
    assert np.any(fine.upper < rough.upper)


def test_a_continuous_joint_is_tried_all_around():
    limits = dict.fromkeys(("lower", "upper", "lower_hard", "upper_hard"))
    joints = tuple(joint(name, **limits) for name in ("shoulder", "elbow", "wrist"))
    arm = describe(urdf=URDF.replace('"revolute"', '"continuous"'), joints=joints)
    turn = torque_acceleration_bounds(build_model(arm), 400)
    given = torque_acceleration_bounds(build_model(arm), 400, lower=-math.pi, upper=math.pi)
    np.testing.assert_array_equal(turn.lower_states, given.lower_states)
    assert np.abs(turn.lower_states[:, 0]).max() <= math.pi
