"""All frames of a robot at once, and what each joint does to them."""

from __future__ import annotations

import numpy as np
import pytest
from support.arm3 import describe
from support.small_arm import arm, one_joint_arm

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.model.kinematics import Kinematics, stacked
from hoap3.robot_emulator.robots import load

ROBOTS = {"hoap3": load("hoap3"), "small": arm(), "arm3": describe(), "one joint": one_joint_arm()}


@pytest.mark.parametrize("name", ROBOTS)
def test_they_are_where_each_is_alone_and_move_as_each_does(name):
    robot = ROBOTS[name]
    kinematics, rng = Kinematics(robot), np.random.default_rng(5)
    numbers = [kinematics.frame_id(frame) for frame in robot.frames]
    root = kinematics.frame_id(robot.structure.root)
    for _ in range(5):
        q = rng.uniform(robot.lower, robot.upper)
        kinematics.update(q)
        origins, rotations, twists, order = (each.copy() for each in kinematics.frames())
        for number in numbers:
            position, rotation = np.zeros(3), np.zeros((3, 3))
            jacobian = np.zeros((6, robot.n))
            kinematics.frame(number, root, position, rotation, jacobian)
            np.testing.assert_array_equal(origins[number], position)
            np.testing.assert_array_equal(rotations[number], rotation)
            v, omega = twists[:3, order], twists[3:, order]
            moved = kinematics.moved_by(number)
            velocity = (v + np.cross(omega.T, position).T) * moved
            np.testing.assert_allclose(velocity, jacobian[:3], rtol=0, atol=1e-14)
            np.testing.assert_allclose(omega * moved, jacobian[3:], rtol=0, atol=1e-14)


def test_a_joint_moves_what_lies_beyond_it():
    kinematics = Kinematics(ROBOTS["hoap3"])
    joints = np.array(ROBOTS["hoap3"].joint_names)
    moved = kinematics.moved_by(kinematics.frame_id("r_sole"))
    assert {name[:5] for name in joints[moved]} >= {"r_hip", "r_ank"}
    assert not any(name.startswith("l_") for name in joints[moved])


def apart(rows: list[int]) -> list[FloatArray]:
    memory = np.arange(40.0).reshape(10, 4)
    return [memory[row, :3] for row in rows]


def test_one_view_of_arrays_at_equal_distances_sees_what_is_written_into_them():
    arrays = apart([1, 3, 5])
    view = stacked(arrays)
    np.testing.assert_array_equal(view, np.stack(arrays))
    arrays[2][:] = 7.0
    np.testing.assert_array_equal(view[2], [7.0, 7.0, 7.0])


@pytest.mark.parametrize("rows", [[0, 1, 3], [0, 1, 1]])
def test_arrays_at_unequal_distances_are_refused(rows):
    with pytest.raises(ValueError, match="equal distances"):
        stacked(apart(rows))


def test_arrays_of_another_layout_are_refused():
    memory = np.zeros((4, 3, 3))
    with pytest.raises(ValueError, match="equal distances"):
        stacked([memory[0], memory[1].T])
