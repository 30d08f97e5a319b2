"""Centre of mass and its Jacobian as controllers see them, in frames all over the robot."""

from __future__ import annotations

import numpy as np
import pytest
from free_flyer import FreeFlyer

from hoap3.protocol.errors import FrameNotFoundError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.robots import load

HOAP3 = load("hoap3")
FRAMES = ["r_sole", "l_sole", "pelvis", "r_forearm"]


def random_postures(description: RobotDescription, count: int) -> FloatArray:
    rng = np.random.default_rng(11)
    return rng.uniform(description.lower, description.upper, (count, description.n))


class Seen:
    """Centre of mass and Jacobian in one frame, as fresh arrays."""

    def __init__(self, description: RobotDescription, frame: str) -> None:
        self.kinematics = Kinematics(description)
        self.frame = self.kinematics.frame_id(frame)

    def __call__(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        position, jacobian = np.full(3, np.nan), np.full((3, len(q)), np.nan)
        self.kinematics.update(q)
        self.kinematics.com(self.frame, position, jacobian)
        return position, jacobian


@pytest.mark.parametrize("frame", FRAMES)
def test_a_floating_model_agrees_at_200_postures(frame):
    seen, floating = Seen(HOAP3, frame), FreeFlyer(HOAP3)
    for q in random_postures(HOAP3, 200):
        for ours, theirs in zip(seen(q), floating.com(frame, q), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)


def test_the_start_posture_has_the_papers_centre_of_mass():
    position, jacobian = Seen(HOAP3, "r_sole")(HOAP3.initial_position)
    np.testing.assert_allclose(position, [-0.0085, 0.0279, 0.2869], rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.svd(jacobian)[1], [0.305, 0.261, 0.052], atol=5e-4)
    error = position - [0.01, 0.025, 0.2869]
    assert np.linalg.norm(error) == pytest.approx(18.73e-3, abs=5e-6)
    assert np.linalg.norm(jacobian.T @ error) == pytest.approx(5.689e-3, abs=5e-7)


@pytest.mark.parametrize("frame", FRAMES)
def test_joints_stay_where_the_wire_has_them(frame):
    order = np.random.default_rng(2).permutation(HOAP3.n)
    shuffled = HOAP3.model_copy(
        update={
            "joints": tuple(HOAP3.joints[i] for i in order),
            "postures": {"q0": tuple(HOAP3.initial_position[order])},
        }
    )
    straight, other = Seen(HOAP3, frame), Seen(shuffled, frame)
    for q in random_postures(HOAP3, 20):
        position, jacobian = straight(q)
        position_too, jacobian_too = other(q[order])
        np.testing.assert_array_equal(position_too, position)
        np.testing.assert_array_equal(jacobian_too, jacobian[:, order])


def test_what_it_wrote_stays_when_it_moves_on():
    seen = Seen(HOAP3, "r_sole")
    first, second = random_postures(HOAP3, 2)
    position, jacobian = seen(first)
    kept = position.copy(), jacobian.copy()
    seen(second)
    np.testing.assert_array_equal(position, kept[0])
    np.testing.assert_array_equal(jacobian, kept[1])


def test_frames_do_not_disturb_each_other():
    alone, kinematics = Seen(HOAP3, "l_sole"), Kinematics(HOAP3)
    frames = [kinematics.frame_id(frame) for frame in FRAMES]
    q = random_postures(HOAP3, 1)[0]
    kinematics.update(q)
    position, jacobian = np.zeros(3), np.zeros((3, HOAP3.n))
    for frame in (*frames, frames[1]):
        kinematics.com(frame, position, jacobian)
    np.testing.assert_array_equal(position, alone(q)[0])
    np.testing.assert_array_equal(jacobian, alone(q)[1])


def test_an_unknown_frame_names_the_known_ones():
    with pytest.raises(FrameNotFoundError, match=r"'r_sol'.*'r_sole'"):
        Kinematics(HOAP3).frame_id("r_sol")
