"""Dynamics of a free base, by differences along its motion and against Newton's laws."""

from dataclasses import dataclass

import numpy as np
import pytest

from hoap3.protocol.errors import DescriptionError, FrameNotFoundError
from hoap3.remote_controller.model.frame_dynamics import FrameRows, FramesDynamics
from hoap3.remote_controller.model.free_dynamics import BASE, FreeDynamics
from hoap3.robot_emulator.robots import load

GRAVITY = 9.81
STEP_S = 1e-5
FRAMES = [
    FrameRows("r_sole", 0, 6),
    FrameRows("l_forearm", 6, 6),
    FrameRows("l_forearm", 12, 3),
    FrameRows("com", 15, 3),
    FrameRows("pelvis", 18, 3, turns=True),
]
M = 21


@dataclass
class Motion:
    """Of base and joints, in the world."""

    place: np.ndarray
    turn: np.ndarray  # as columns: the base's axes
    velocity: np.ndarray
    omega: np.ndarray
    q: np.ndarray
    dq: np.ndarray


def exponential(w: np.ndarray) -> np.ndarray:
    angle = np.linalg.norm(w)
    x, y, z = w / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def quaternion(R: np.ndarray) -> np.ndarray:
    """Of a rotation by less than half a turn, x y z w."""
    w = 0.5 * np.sqrt(1.0 + np.trace(R))
    x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    return np.array([x / (4 * w), y / (4 * w), z / (4 * w), w])


def some_motion(n: int) -> Motion:
    random = np.random.default_rng(7)
    turn = exponential(random.normal(size=3) * 0.5)
    vectors = random.normal(size=(3, 3))
    return Motion(vectors[0], turn, *vectors[1:], *(random.normal(size=(2, n)) * 0.3))


def take(dynamics: FreeDynamics, motion: Motion) -> None:
    parts = motion.place, quaternion(motion.turn), motion.velocity, motion.omega
    dynamics.base[:] = np.concatenate(parts)
    dynamics.update(motion.q, motion.dq)


def after(motion: Motion, t: float) -> Motion:
    """A time t on, without accelerations: the twist of the base in its own axes is the same."""
    v, w = motion.turn.T @ motion.velocity, motion.turn.T @ motion.omega
    turn = motion.turn @ exponential(w * t)
    half = motion.turn @ exponential(0.5 * w * t)
    return Motion(
        motion.place + half @ v * t, turn, turn @ v, turn @ w, motion.q + motion.dq * t, motion.dq
    )


@pytest.fixture(scope="module")
def dynamics() -> FreeDynamics:
    return FreeDynamics(load("hoap3"), FRAMES, M)


def test_rows_are_velocities_and_drift_is_their_rate_without_accelerations(dynamics):
    motion = some_motion(dynamics.n)
    sides = []
    for t in (STEP_S, -STEP_S):
        take(dynamics, after(motion, t))
        sides.append((dynamics.twist.copy(), dynamics.origins.copy(), dynamics.rotations.copy()))
    take(dynamics, motion)
    (twist, origins, turns), (before, places, other) = sides
    assert np.allclose(dynamics.jacobian @ dynamics.velocity, dynamics.twist, atol=1e-12)
    assert np.allclose((twist - before) / (2 * STEP_S), dynamics.drift, atol=1e-7)
    moved = (origins - places) / (2 * STEP_S)
    assert np.allclose(moved[2], dynamics.twist[12:15], atol=1e-8)
    assert np.allclose(moved[3], dynamics.twist[15:18], atol=1e-8)
    spin = (turns[4] - other[4]) / (2 * STEP_S) @ dynamics.rotations[4].T
    assert np.allclose([spin[2, 1], spin[0, 2], spin[1, 0]], dynamics.twist[18:21], atol=1e-8)
    own = dynamics.rotations[1] @ dynamics.twist[6:9]
    assert np.allclose(own, dynamics.twist[12:15], atol=1e-12)


def test_what_falls_freely_keeps_its_momentum_but_for_gravity(dynamics):
    motion = some_motion(dynamics.n)
    take(dynamics, motion)
    v = np.linalg.solve(dynamics.mass, -dynamics.bias)
    fall = dynamics.jacobian[15:18] @ v + dynamics.drift[15:18]
    assert np.allclose(fall, [0.0, 0.0, -GRAVITY], atol=1e-9)
    whole = dynamics.mass[:3, :3]
    assert np.allclose(whole, dynamics.total_mass * np.eye(3), atol=1e-9)
    assert np.allclose(dynamics.mass, dynamics.mass.T)


def test_with_a_base_at_rest_joints_are_those_of_the_robot_whose_base_stands(dynamics):
    robot, n = load("hoap3"), dynamics.n
    frames = [FrameRows("r_sole", 0, 6), FrameRows("l_forearm", 6, 6)]
    fixed, motion = FramesDynamics(robot, frames, 12), some_motion(n)
    still = Motion(np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3), motion.q, motion.dq)
    take(dynamics, still)
    fixed.update(motion.q, motion.dq)
    assert np.allclose(dynamics.mass[BASE:, BASE:], fixed.mass, atol=1e-12)
    assert np.allclose(dynamics.bias[BASE:], fixed.bias, atol=1e-12)
    assert np.allclose(dynamics.jacobian[:12, BASE:], fixed.jacobian, atol=1e-12)
    assert np.allclose(dynamics.drift[:12], fixed.drift, atol=1e-12)
    assert np.allclose(dynamics.origins[:2], fixed.origins, atol=1e-12)


def test_a_robot_that_adds_what_holds_it_and_an_unknown_frame_are_refused():
    robot = load("hoap3")
    with pytest.raises(FrameNotFoundError):
        FreeDynamics(robot, [FrameRows("tail", 0, 6)], 6)
    with pytest.raises(DescriptionError):
        FreeDynamics(robot.model_copy(update={"gravity": "compensated"}), [], 0)
