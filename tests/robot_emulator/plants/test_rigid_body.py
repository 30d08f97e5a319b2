"""A body under torques, against physics and against Pinocchio's own mass matrix."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strong_arms import changed, small, strong

from hoap3.protocol.errors import DescriptionError
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.robot_emulator.config import PlantSettings
from hoap3.robot_emulator.plants.acceleration_servo import AccelerationServo
from hoap3.robot_emulator.plants.rigid_body import SLIDING, RigidBody

T = 0.001
FRICTIONLESS = {"friction": False}


def body(description: RobotDescription, **settings: object) -> RigidBody:
    made = RigidBody(description, PlantSettings(**settings))
    made.reset(description.initial_position)
    return made


def rubbed(damping: float, friction: float) -> RobotDescription:
    arm = small("torque", gravity="none")
    dynamics = f'<dynamics damping="{damping}" friction="{friction}"/></joint>\n  <link name="upper'
    return arm.model_copy(
        update={"urdf": arm.urdf.replace('</joint>\n  <link name="upper', dynamics)}
    )


def energy(description: RobotDescription, q: np.ndarray, dq: np.ndarray) -> float:
    """Kinetic and potential, by Pinocchio's own functions."""
    import pinocchio as pin

    robot = Dynamics(description).robot
    place, speed = np.zeros(robot.model.nq), np.zeros(robot.model.nv)
    place[robot.order], speed[robot.order] = q, dq
    kinetic = pin.computeKineticEnergy(robot.model, robot.data, place, speed)
    return float(kinetic + pin.computePotentialEnergy(robot.model, robot.data, place))


def fall(description: RobotDescription, substeps: int, periods: int) -> RigidBody:
    arm = body(description, substeps=substeps, **FRICTIONLESS)
    for _ in range(periods):
        arm.step(np.zeros(description.n), T)
    return arm


def test_energy_is_kept_without_friction_the_better_the_smaller_the_steps():
    arm = small("torque")
    start = energy(arm, arm.initial_position, np.zeros(3))
    moved = energy(arm, fall(arm, 4, 150).q, np.zeros(3))
    assert abs(moved - start) > 0.1  # it fell a good deal
    off = []
    for substeps in (1, 4, 16):
        fallen = fall(arm, substeps, 150)
        off.append(abs(energy(arm, fallen.q, fallen.dq) - start))
    assert off[2] < 1e-3
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.2)
    assert off[1] / off[2] == pytest.approx(4.0, rel=0.2)


@cache
def tireless(gravity: str) -> tuple[RobotDescription, RigidBody]:
    """An arm of any effort."""
    description = strong("torque", gravity, times=1e3)
    return description, body(description)


@given(seed=st.integers(0, 2**32 - 1))
def test_accelerations_and_torques_undo_each_other(seed: int):
    rng = np.random.default_rng(seed)
    for gravity in ("full", "compensated", "none"):
        description, arm = tireless(gravity)
        arm.q[:] = rng.uniform(description.lower, description.upper)
        arm.dq[:] = rng.uniform(-1.0, 1.0, 7) * description.velocity
        wanted = rng.uniform(-1.0, 1.0, 7) * description.brake_acceleration
        torques, given_back = np.zeros(7), np.zeros(7)
        assert arm.torques(wanted, T, torques) == -1
        assert arm.accelerations(torques, T, given_back) == -1
        np.testing.assert_allclose(given_back, wanted, rtol=1e-9, atol=1e-9)


def test_a_rotor_adds_its_inertia_to_its_own_joint():
    import pinocchio as pin

    light = small("torque")
    dynamics, q = Dynamics(changed(light, armature=0.3)), light.initial_position
    robot = Dynamics(light).robot
    M = pin.crba(robot.model, robot.data, q)
    M = np.triu(M) + np.triu(M, 1).T + 0.3 * np.eye(3)
    found, still, pushed = np.zeros(3), np.zeros(3), np.array([1.0, -2.0, 0.5])
    weight = np.zeros(3)
    dynamics.gravity(q, weight)
    dynamics.forward(q, still, pushed + weight, still, found)
    np.testing.assert_allclose(found, np.linalg.solve(M, pushed), rtol=1e-12)


@pytest.mark.parametrize("gravity", ["full", "compensated", "none"])
def test_what_holds_it_holds_it(gravity: str):
    arm = small("torque", gravity)
    held, weight = body(arm), np.zeros(3)
    if gravity == "full":
        Dynamics(arm).gravity(arm.initial_position, weight)
    for _ in range(1000):
        held.step(weight, T)
    np.testing.assert_allclose(held.q, arm.initial_position, atol=1e-9)


def test_torques_beyond_the_efforts_are_the_efforts():
    arm = small("torque")
    modest, greedy = body(arm), body(arm)
    for _ in range(50):
        modest.step(np.array([20.0, -20.0, 20.0]), T)
        greedy.step(np.array([1e9, -1e9, 1e9]), T)
    np.testing.assert_array_equal(modest.q, greedy.q)
    np.testing.assert_array_equal(np.abs(greedy.tau), arm.effort)


def test_compensation_is_within_the_efforts_too():
    weak = body(changed(small("torque", "compensated"), effort=1.0))
    weak.step(np.zeros(3), T)
    assert np.abs(weak.tau).max() == 1.0
    assert weak.dq[1] > 0.0  # it falls


@pytest.mark.parametrize(("damping", "friction"), [(0.0, 0.5), (1e4, 0.0), (0.0, 1e4), (1e4, 1e4)])
def test_friction_slows_and_never_shakes_however_strong(damping: float, friction: float):
    arm = body(rubbed(damping, friction))
    arm.dq[0] = 1.0
    speeds = []
    for _ in range(300):
        arm.step(np.zeros(3), T)
        speeds.append(arm.dq[0])
    assert np.all(np.diff(speeds) <= 1e-12)
    assert -1e-9 <= speeds[-1] < 0.9


def test_a_joint_under_less_than_its_friction_creeps_and_under_more_moves_away():
    light, heavy = body(rubbed(0.0, 2.0)), body(rubbed(0.0, 2.0))
    for _ in range(500):
        light.step(np.array([1.0, 0.0, 0.0]), T)
        heavy.step(np.array([3.0, 0.0, 0.0]), T)
    assert 0.0 < light.dq[0] <= SLIDING * 0.51
    assert heavy.dq[0] > 10 * SLIDING


def test_a_mechanical_stop_holds_without_rebound_and_lets_go():
    arm = small("torque", "none")
    joint = body(arm, **FRICTIONLESS)
    push = np.array([20.0, 0.0, 0.0])
    for _ in range(2000):
        joint.step(push, T)
        assert joint.q[0] <= arm.upper_hard[0]
    assert joint.q[0] == arm.upper_hard[0]
    assert joint.dq[0] == 0.0
    joint.step(-push, T)
    assert joint.q[0] < arm.upper_hard[0]


def test_brakes_hold_it_against_gravity_and_show_what_they_carry():
    arm = small("torque")
    held = body(arm)
    held.step(np.array([5.0, 0.0, 0.0]), T)
    place = held.q.copy()
    held.hold(T)
    carried = np.zeros(3)
    Dynamics(arm).gravity(place, carried)
    np.testing.assert_array_equal(held.q, place)
    np.testing.assert_array_equal(held.dq, 0.0)
    np.testing.assert_array_equal(held.tau, carried)


def test_a_joint_that_moves_nothing_that_weighs_is_refused():
    """An armature is enough."""
    arm = small("torque")
    inertia = '<inertia ixx="0.0003" iyy="0.0005" izz="0.0005" ixy="0" ixz="0" iyz="0"/>'
    none = inertia.replace("0.0003", "0").replace("0.0005", "0")
    light = arm.urdf.replace(inertia, none).replace('<mass value="0.4"/>', '<mass value="0"/>')
    with pytest.raises(DescriptionError, match="'wrist'"):
        body(arm.model_copy(update={"urdf": light}))
    body(changed(arm, armature=1e-3).model_copy(update={"urdf": light}))


@pytest.mark.parametrize("gravity", ["full", "compensated"])
def test_joints_whose_efforts_suffice_get_their_accelerations_beside_those_that_lack(gravity: str):
    """Friction and all; whoever lacks gives all it has."""
    rng = np.random.default_rng(4)
    some, all_of_them = 0, 0
    for _ in range(100):
        description = strong("torque", gravity, times=rng.choice([0.05, 0.2, 1.0]))
        arm = body(description)
        arm.q[:] = rng.uniform(description.lower, description.upper)
        arm.dq[:] = 0.3 * rng.uniform(-1.0, 1.0, 7) * description.velocity
        wanted = rng.uniform(-1.0, 1.0, 7) * description.brake_acceleration
        torques, found = np.zeros(7), np.zeros(7)
        weak = arm.torques(wanted, T, torques)
        assert arm.accelerations(torques, T, found) == -1
        lacks = np.abs(arm.tau) >= description.effort * (1 - 1e-12)
        assert (weak >= 0) == bool(lacks.any())
        np.testing.assert_allclose(found[~lacks], wanted[~lacks], rtol=1e-6, atol=1e-6)
        some, all_of_them = some + bool(lacks.any()), all_of_them + bool(lacks.all())
    assert some > 50
    assert all_of_them < some


def test_substeps_are_steps_of_their_own():
    description = rubbed(3.0, 0.5)
    once, often = body(description, substeps=4), body(description, substeps=1)
    push = np.array([5.0, 1.0, -1.0])
    for _ in range(50):
        once.step(push, T)
        for _ in range(4):
            often.step(push, T / 4)
    np.testing.assert_array_equal(once.q, often.q)
    np.testing.assert_array_equal(once.dq, often.dq)


def test_brakes_stop_a_body_of_accelerations_where_it_is_and_show_what_they_carry():
    arm = small("acceleration")
    servo = AccelerationServo(arm)
    servo.reset(arm.initial_position)
    servo.step(np.array([1.0, -2.0, 3.0]), T)
    place, needed = servo.q.copy(), np.zeros(3)
    Dynamics(arm).inverse(place, servo.dq, np.array([1.0, -2.0, 3.0]), needed)
    np.testing.assert_array_equal(servo.tau, needed)
    servo.hold(T)
    Dynamics(arm).gravity(place, needed)
    np.testing.assert_array_equal(servo.q, place)
    np.testing.assert_array_equal(servo.dq, 0.0)
    np.testing.assert_allclose(servo.tau, needed, atol=1e-12)
