"""Algorithm 4: Pinocchio's dynamics, the bounds of the states themselves, and what is refused."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.arm3 import URDF, describe, joint
from support.robots.following_trees import following_tree
from support.robots.full_model import FullModel
from support.robots.random_trees import random_tree

from hoap3.protocol.errors import BadProblemError
from hoap3.protocol.limits.torque_bounds import BATCH
from hoap3.protocol.robot.pinocchio_model import RobotModel, build_model
from hoap3.remote_controller.bounds import torque_acceleration_bounds
from hoap3.robot_emulator.robots import available, load

SEEDS = st.integers(0, 2**32 - 1)
every = pytest.mark.parametrize("name", available())


@cache
def model(name: str) -> RobotModel:
    return build_model(load(name))


def by_pinocchio(robot: RobotModel, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bias and diagonal of the mass matrix, all in wire order."""
    q_there, dq_there = np.empty(robot.model.nq), np.empty(robot.model.nv)
    q_there[robot.order], dq_there[robot.order] = q, dq
    bias = pin.nle(robot.model, robot.data, q_there, dq_there)[robot.order]
    return bias, pin.crba(robot.model, robot.data, q_there).diagonal()[robot.order].copy()


def bounds_of_states(robot: RobotModel, samples: int, corners: bool) -> tuple[np.ndarray, ...]:
    """Algorithm 4, line by line, on the states that the seed 0 gives."""
    described, n = robot.description, robot.description.n
    there = np.array([described.lower, described.upper, described.velocity, described.effort])
    rng = np.random.default_rng(0)
    drawn = np.vstack([rng.random((BATCH, 2 * n)) for _ in range(-(-samples // BATCH))])[:samples]
    lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
    for row in drawn:
        q = there[0] + row[:n] * (there[1] - there[0])
        dq = there[2] * (np.where(row[n:] >= 0.5, 1.0, -1.0) if corners else 2 * row[n:] - 1)
        h, M = by_pinocchio(robot, q, dq)
        lower = np.maximum(lower, (-there[3] - h) / M)
        upper = np.minimum(upper, (there[3] - h) / M)
    return lower, upper


@every
@pytest.mark.parametrize("velocities", ["corners", "uniform"])
def test_the_bounds_are_those_of_the_algorithm(name, velocities):
    """Over the edge of a batch, in wire order."""
    samples = BATCH + 300 if name == "lwr" else 500
    found = torque_acceleration_bounds(model(name), samples, velocities=velocities)
    lower, upper = bounds_of_states(model(name), samples, velocities == "corners")
    np.testing.assert_allclose(found.lower, lower, rtol=1e-10)
    np.testing.assert_allclose(found.upper, upper, rtol=1e-10)
    assert found.joints == load(name).joint_names
    assert found.samples == samples


def check_states(robot: RobotModel, found, velocity: np.ndarray, corners: bool) -> None:
    described = robot.description
    for place in range(described.n):
        for states, bound, sign in (
            (found.lower_states, found.lower, -1.0),
            (found.upper_states, found.upper, 1.0),
        ):
            q, dq = states[place]
            h, M = by_pinocchio(robot, q, dq)
            there = (sign * described.effort[place] - h[place]) / M[place]
            assert there == pytest.approx(bound[place], rel=1e-10)
            assert np.all((q >= described.lower) & (q <= described.upper))
            assert np.all(np.abs(dq) == velocity if corners else np.abs(dq) <= velocity)


@pytest.mark.parametrize("name", ["hoap3", "lwr"])
@pytest.mark.parametrize("velocities", ["corners", "uniform"])
def test_every_bound_comes_with_the_state_that_gave_it(name, velocities):
    found = torque_acceleration_bounds(model(name), 2000, velocities=velocities, seed=4)
    check_states(model(name), found, load(name).velocity, velocities == "corners")


@settings(max_examples=10)
@given(seed=SEEDS, n=st.integers(1, 6))
def test_polishing_never_widens_them_and_stays_inside_the_limits(seed, n):
    robot = build_model(random_tree(seed, n))
    rough = torque_acceleration_bounds(robot, 300, seed=seed)
    fine = torque_acceleration_bounds(robot, 300, seed=seed, polish=2)
    assert np.all(fine.lower >= rough.lower)
    assert np.all(fine.upper <= rough.upper)
    check_states(robot, fine, robot.description.velocity, corners=False)


def test_the_seed_alone_decides():
    robot = model("ur5")
    first, again, other = (torque_acceleration_bounds(robot, 5000, seed=seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(first.lower, again.lower)
    np.testing.assert_array_equal(first.upper_states, again.upper_states)
    assert np.any(first.lower != other.lower)


def test_a_pendulum_has_what_its_weight_leaves():
    """At q its weight asks −mgl cos q of the joint; |q| ≤ 2, where cos q is from −0.42 to 1."""
    pendulum = (
        '<robot name="p"><link name="base"/><link name="rod"><inertial><origin xyz="0.5 0 0"/>'
        '<mass value="2"/><inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/>'
        '</inertial></link><joint name="turn" type="revolute"><parent link="base"/>'
        '<child link="rod"/><axis xyz="0 1 0"/>'
        '<limit lower="-2" upper="2" velocity="3" effort="30"/></joint></robot>'
    )
    joint = load("ur5").joints[0].model_copy(update={"name": "turn", "effort": 30.0})
    robot = build_model(
        load("ur5").model_copy(
            update={
                "urdf": pendulum,
                "joints": (joint.model_copy(update={"armature": 0.5}),),
                "postures": {"zero": (0.0,)},
                "initial_posture": "zero",
                "base_frame": "base",
                "default_task": None,
            }
        )
    )
    found = torque_acceleration_bounds(robot, 100, polish=3, lower=-2.0, upper=2.0)
    weight, inertia = 2 * 9.81 * 0.5, 2 * 0.25 + 1e-9 + 0.5
    np.testing.assert_allclose(found.upper, (30 + weight * np.cos(2.0)) / inertia, rtol=1e-9)
    np.testing.assert_allclose(found.lower, (weight - 30) / inertia, rtol=1e-9)
    np.testing.assert_array_equal(found.either_way, -found.lower)
    weak = torque_acceleration_bounds(robot, 100, polish=3, lower=-2.0, upper=2.0, effort=5.0)
    np.testing.assert_allclose(weak.lower, (weight - 5) / inertia, rtol=1e-9)
    assert weak.none == ("turn",)
    assert weak.either_way[0] < 0.0


def test_baxters_s1_has_no_acceleration_in_every_state_and_is_named():
    found = torque_acceleration_bounds(model("baxter_left_arm"), 100_000)
    assert found.none == ("left_s1",)
    assert found.lower[1] > found.upper[1]
    assert found.either_way[1] < 0.0
    assert np.all(np.delete(found.either_way, 1) > 0.0)


def test_baxters_s0_polished_is_the_true_worst_case():
    """5.09 rad/s², by a quasi-Newton search from many states; corners alone come within a tenth."""
    corners = torque_acceleration_bounds(model("baxter_left_arm"), 100_000, polish=6)
    assert corners.upper[0] == pytest.approx(5.09, abs=0.02)
    assert -corners.lower[0] == pytest.approx(5.09, abs=0.02)
    rough = torque_acceleration_bounds(model("baxter_left_arm"), 100_000)
    assert 5.07 < rough.upper[0] < 6.3
    uniform = torque_acceleration_bounds(model("baxter_left_arm"), 100_000, velocities="uniform")
    assert uniform.upper[0] > 7.0


@pytest.mark.parametrize("name", [name for name in available() if name != "hoap3"])
def test_shipped_accelerations_are_what_the_torques_can_give(name):
    found = torque_acceleration_bounds(model(name), 50_000)
    usable = found.lower < found.upper
    assert np.all(load(name).brake_acceleration[usable] < found.either_way[usable])
    uniform = torque_acceleration_bounds(model(name), 50_000, velocities="uniform")
    assert np.all(load(name).setpoint_acceleration_max[usable] < uniform.either_way[usable])


def test_limits_can_be_replaced():
    robot, n = model("lwr"), 7
    still = torque_acceleration_bounds(robot, 300, velocity=0.0)
    weak = torque_acceleration_bounds(robot, 300, velocity=0.0, effort=np.full(n, 80.0))
    assert np.all(still.lower_states[:, 1] == 0.0)
    assert np.all(weak.upper[:2] < still.upper[:2])
    fixed = torque_acceleration_bounds(robot, 10, lower=np.full(n, 0.3), upper=0.3)
    assert np.all(fixed.lower_states[:, 0] == 0.3)


def test_progress_is_told_to_the_end():
    told: list[tuple[int, int]] = []
    samples = 2 * BATCH + 5
    torque_acceleration_bounds(
        model("ur5"), samples, report=lambda done, whole: told.append((done, whole))
    )
    assert told == [(BATCH, samples), (2 * BATCH, samples), (samples, samples)]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"lower": -np.inf}, "joint_1.*lower.*-inf"),
        ({"upper": [1, 1, np.inf, 1, 1, 1, 1]}, "joint_3.*upper.*inf"),
        ({"lower": [-1, -1, -1, 2, -1, -1, -1], "upper": 1.0}, "joint_4.*2 to 1"),
        ({"velocity": -1.0}, "velocity -1"),
        ({"effort": 0.0}, "effort 0"),
        ({"effort": [1.0, 2.0]}, "effort.* 7"),
        ({"velocity": 1e200}, "torque"),
        ({"velocities": "corner"}, "velocities.*'corner'.*corners or uniform"),
        ({"samples": 0}, "samples.*0"),
        ({"samples": 1e6}, "samples.*1000000.0"),
        ({"polish": -1}, "polish.*-1"),
        ({"seed": -1}, "seed.*-1"),
    ],
)
def test_what_is_wrong_is_named(changed, words):
    with pytest.raises(BadProblemError, match=words):
        torque_acceleration_bounds(model("lwr"), **{"samples": 10, **changed})


def test_a_joint_that_moves_nothing_that_weighs_is_named():
    hand = URDF.index('<link name="hand">')
    light = URDF[:hand] + URDF[hand:].replace(
        URDF[URDF.index("<inertial>", hand) : URDF.index("</inertial>", hand) + 11], ""
    )
    robot = build_model(describe(urdf=light))
    with pytest.raises(BadProblemError, match="joint wrist"):
        torque_acceleration_bounds(robot, 10)


@settings(max_examples=6)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 3), f=st.integers(1, 3))
def test_mimic_joints_count_in_bias_and_inertia(seed, n, f):
    robot = following_tree(seed, n, f)
    plain = FullModel(robot)
    found = torque_acceleration_bounds(build_model(robot), 10, polish=1, lower=-2.0, upper=2.0)
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


def test_a_continuous_joint_is_tried_all_around():
    limits = dict.fromkeys(("lower", "upper", "lower_hard", "upper_hard"))
    joints = tuple(joint(name, **limits) for name in ("shoulder", "elbow", "wrist"))
    arm = describe(urdf=URDF.replace('"revolute"', '"continuous"'), joints=joints)
    turn = torque_acceleration_bounds(build_model(arm), 400)
    given = torque_acceleration_bounds(build_model(arm), 400, lower=-math.pi, upper=math.pi)
    np.testing.assert_array_equal(turn.lower_states, given.lower_states)
    assert np.abs(turn.lower_states[:, 0]).max() <= math.pi
