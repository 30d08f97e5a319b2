"""What a robot stands on: forces in the world, zero-moment point, support polygon."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import hoap3
from hoap3.protocol.messages import State
from hoap3.tools.view.picture.contacts import Contacts
from hoap3.tools.view.picture.kinematics import Poses

ARRAYS = {"base": 13, "contact": 12}


@pytest.fixture(scope="module")
def robot():
    return hoap3.load_robot("hoap3").model_copy(update={"state_arrays": ARRAYS})


@pytest.fixture
def standing(robot):
    """A State on both soles, tilted a little, and its kinematics."""
    state = State.allocate(**robot.state_lengths)
    state.q[:] = robot.initial_position
    base = pin.SE3(pin.rpy.rpyToMatrix(0.05, -0.03, 0.4), np.array([0.3, -0.2, 0.3]))
    state.base[:7] = pin.SE3ToXYZQUAT(base)
    poses = Poses(robot)
    poses.update(state.q, state.base)
    return state, poses


def test_a_force_acts_at_the_centre_of_pressure(robot, standing):
    state, poses = standing
    at, force = np.array([0.02, -0.01, 0.0]), np.array([3.0, -2.0, 60.0])
    state.contact[:3], state.contact[3:6] = force, np.cross(at, force)
    (found,) = Contacts(robot, None).look(state, poses)["contacts"]
    sole = poses.placement(robot.soles[0].frame)
    assert np.allclose(found["at"], sole.act(at), atol=1e-6)
    assert np.allclose(found["force"], sole.rotation @ force, atol=1e-4)


def test_about_the_zero_moment_point_the_ground_has_no_torque_about_level_axes(robot, standing):
    state, poses = standing
    state.contact[:] = [3.0, -2.0, 40.0, 0.3, -0.5, 0.1, -1.0, 4.0, 25.0, -0.2, 0.4, 0.0]
    zmp = Contacts(robot, None).look(state, poses)["zmp"]
    soles = [poses.placement(sole.frame) for sole in robot.soles]
    forces = [sole.rotation @ state.contact[6 * i : 6 * i + 3] for i, sole in enumerate(soles)]
    up = [force[2] for force in forces]
    height = np.average([sole.translation[2] for sole in soles], weights=up)
    moment = np.zeros(3)
    for i, (sole, force) in enumerate(zip(soles, forces, strict=True)):
        moment += sole.rotation @ state.contact[6 * i + 3 : 6 * i + 6]
        moment += np.cross(sole.translation - [*zmp, height], force)
    assert np.allclose(moment[:2], 0.0, atol=1e-3)  # N m: of a place that is rounded to 1 µm


def test_the_polygon_is_around_the_soles_that_bear(robot, standing):
    state, poses = standing
    state.contact[2] = 50.0
    one = Contacts(robot, None).look(state, poses)["polygon"]
    assert len(one) == 4
    state.contact[8] = 50.0
    both = np.array(Contacts(robot, None).look(state, poses)["polygon"])
    corners = [
        poses.placement(sole.frame).act(np.array([x, y, 0.0]))[:2]
        for sole in robot.soles
        for x, y in sole.polygon
    ]
    edges = np.roll(both, -1, axis=0) - both
    for corner in corners:
        out = edges[:, 0] * (corner - both)[:, 1] - edges[:, 1] * (corner - both)[:, 0]
        assert (out > -1e-8).all()  # left of each edge: inside
    assert len(both) >= 6


def test_in_the_air_there_is_neither(robot, standing):
    state, poses = standing
    found = Contacts(robot, None).look(state, poses)
    assert found == {"contacts": [], "zmp": None, "polygon": None}


def test_without_forces_those_soles_count_that_are_said_to_stand():
    robot = hoap3.load_robot("hoap3")
    state = State.allocate(**robot.state_lengths)
    poses = Poses(robot)
    poses.update(robot.initial_position)
    found = Contacts(robot, None, ["r_sole"]).look(state, poses)
    expected = next(sole for sole in robot.soles if sole.frame == "r_sole").polygon
    assert {tuple(each) for each in np.round(found["polygon"], 9)} == set(expected)


def test_a_wrench_sensor_shows_what_it_feels():
    robot = hoap3.load_robot("lwr")
    state = State.allocate(**robot.state_lengths)
    state.wrench[:3] = [0.0, 2.0, 5.0]
    poses = Poses(robot)
    poses.update(robot.initial_position)
    (found,) = Contacts(robot, None).look(state, poses)["contacts"]
    tool = poses.placement("ee")
    assert np.allclose(found["at"], tool.translation, atol=1e-6)
    assert np.allclose(found["force"], tool.rotation @ [0.0, 2.0, 5.0], atol=1e-4)


def test_forces_of_links_that_the_emulator_names(standing):
    robot = hoap3.load_robot("hoap3").model_copy(
        update={"state_arrays": {"base": 13, "contact": 6}}
    )
    _, poses = standing
    state = State.allocate(**robot.state_lengths)
    state.contact[:3] = [0.0, 0.0, 9.0]
    assert not Contacts(robot, None).look(state, poses)["contacts"]  # one of two soles: which?
    emulator = {"plant": {"parameters": {"contact_frames": ["pelvis"]}}}
    (found,) = Contacts(robot, emulator).look(state, poses)["contacts"]
    assert np.allclose(found["at"], poses.placement("pelvis").translation, atol=1e-6)
