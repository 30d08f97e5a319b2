"""Links are drawn where Pinocchio's own kinematics and a camera written down here put them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from support.robots.following_arm import following

from hoap3.robot_emulator.robots import load
from hoap3.tools.picture.body import Body
from hoap3.tools.picture.camera import Camera


def places(description, q, root) -> np.ndarray:
    """Origins of all links in the world, (links, 3), by Pinocchio with the root as a free flyer."""
    model = pin.buildModelFromXML(description.urdf, pin.JointModelFreeFlyer())
    full = pin.neutral(model)
    full[:7] = root
    for name, value in zip(description.joint_names, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        full[joint.idx_q : joint.idx_q + joint.nq] = (
            value if joint.nq == 1 else (np.cos(value), np.sin(value))
        )
    data = model.createData()
    pin.framesForwardKinematics(model, data, full)
    frames = [model.getFrameId(name, pin.FrameType.BODY) for name in description.frames]
    return np.array([data.oMf[frame].translation for frame in frames])


def seen(points, azimuth_deg, elevation_deg) -> np.ndarray:
    """Turned so that the eye is on the x axis: y is to the right, z up."""
    a, e = np.radians((azimuth_deg, elevation_deg))
    about_z = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])
    about_y = np.array([[np.cos(e), 0, np.sin(e)], [0, 1, 0], [-np.sin(e), 0, np.cos(e)]])
    return (points @ about_z.T @ about_y.T)[:, 1:]


@pytest.mark.parametrize("name", ["hoap3", "ur5", "baxter_left_arm"])
@pytest.mark.parametrize("seed", range(3))
def test_projected_origins_are_those_of_pinocchios_frames(name, seed):
    rng, description = np.random.default_rng(seed), load(name)
    q = rng.uniform(description.lower, description.upper)
    root = np.array([*rng.uniform(-1, 1, 3), *rng.normal(size=4)])
    root[3:] /= np.linalg.norm(root[3:])
    placed = Body(description).place(q, np.array([*root, *np.zeros(6)]))
    expected = places(description, q, root)
    assert placed.origins == pytest.approx(expected, abs=1e-12)
    azimuth, elevation = rng.uniform(-180, 180), rng.uniform(-89, 89)
    camera = Camera.around(placed.origins, 300, 200, 10.0, azimuth, elevation)
    drawn, flat = camera.project(placed.origins), seen(expected, azimuth, elevation)
    flat = flat * [1.0, -1.0] * camera.scale
    assert drawn - drawn[0] == pytest.approx(flat - flat[0], abs=1e-9)


@pytest.mark.parametrize("name", ["hoap3", "ur5"])
def test_without_a_free_base_the_base_frame_is_the_worlds_origin(name):
    description = load(name)
    q = np.random.default_rng(1).uniform(description.lower, description.upper)
    placed = Body(description).place(q, np.empty(0))
    base = placed.frames[description.base_frame]
    assert placed.origins[base] == pytest.approx(np.zeros(3), abs=1e-12)
    assert placed.rotations[base] == pytest.approx(np.eye(3), abs=1e-12)
    expected = places(description, q, [0, 0, 0, 0, 0, 0, 1])
    apart = np.linalg.norm(expected[:, None] - expected, axis=2)
    ours = np.linalg.norm(placed.origins[:, None] - placed.origins, axis=2)
    assert ours == pytest.approx(apart, abs=1e-12)


def test_mimic_joints_move_with_their_masters():
    description = following()
    body = Body(description)
    still, moved = (body.place(np.full(description.n, value)) for value in (0.0, 0.02))
    turned = [
        name
        for name, k in still.frames.items()
        if not np.allclose(still.rotations[k], moved.rotations[k])
        or not np.allclose(still.origins[k], moved.origins[k])
    ]
    assert set(turned) == set(description.frames) - {"base"}


def test_corners_move_with_their_links():
    description = load("ur5")
    body = Body(description)
    q = np.random.default_rng(2).uniform(-1, 1, description.n)
    placed = body.place(q)
    start = body.place(np.zeros(description.n))
    for face, before in zip(body.faces(placed), body.faces(start), strict=True):
        link = placed.frames[body.solids[face.index].link]
        own = (before.corners - start.origins[link]) @ start.rotations[link]
        assert face.corners == pytest.approx(
            own @ placed.rotations[link].T + placed.origins[link], abs=1e-12
        )


def test_a_quaternion_may_have_any_length_and_zero_turns_nothing():
    description = load("hoap3")
    body, root = Body(description), description.frames.index(description.structure.root)
    for given in (*np.random.default_rng(0).normal(size=(5, 4)), np.zeros(4)):
        placed = body.place(description.initial_position, np.array([0.1, 0.2, 0.3, *given]))
        length = np.linalg.norm(given)
        turn = pin.Quaternion(given / length).matrix() if length else np.eye(3)
        assert placed.rotations[root] == pytest.approx(turn, abs=1e-14)
        assert placed.origins[root] == pytest.approx([0.1, 0.2, 0.3], abs=1e-14)


def test_a_camera_sees_all_points_and_keeps_away_from_the_edge():
    rng = np.random.default_rng(4)
    points = rng.normal(size=(50, 3)) * [1.0, 3.0, 0.2]
    for width, height in ((300, 100), (100, 300)):
        drawn = Camera.around(points, width, height, 9.0, 30.0, 40.0).project(points)
        assert drawn.min() == pytest.approx(9.0, abs=1e-9)
        assert (drawn >= 9.0 - 1e-9).all()
        assert (drawn <= np.array([width, height]) - 9.0 + 1e-9).all()
