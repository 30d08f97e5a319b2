"""Published frames are where Pinocchio has the links, as two decoders read them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from mcap_ros2._dynamic import generate_dynamic
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from support.robots.following_arm import following
from support.small_arm import arm

from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import RobotModel, build_model
from hoap3.robot_emulator.robots import load
from hoap3.tools.bridge.frame_transforms import SCHEMA, SCHEMA_NAME, FrameTransforms, world_frame

ROBOTS = {
    "hoap3": load("hoap3"),
    "baxter": load("baxter_left_arm"),
    "arm": arm(),
    "followers": following(),
}
NOBODY = np.zeros(0)
STAMP = 1_700_000_000_123_456_789
STORE = get_typestore(Stores.EMPTY)
STORE.register(get_types_from_msg(SCHEMA, SCHEMA_NAME))
DECODERS = {
    "rosbags": lambda payload: STORE.deserialize_cdr(payload, SCHEMA_NAME),
    "mcap": generate_dynamic(SCHEMA_NAME, SCHEMA)[SCHEMA_NAME],
}


def by_pinocchio(built: RobotModel, q: np.ndarray) -> dict[str, pin.SE3]:
    """Each link as seen from the root link."""
    ours = np.zeros(built.model.nq)
    ours[built.order] = built.mimic_joints.positions(q) if built.mimic_joints else q
    pin.framesForwardKinematics(built.model, built.data, ours)
    return {link: built.data.oMf[built.frames[link]].copy() for link in built.frames}


def published(decoder: str, robot: RobotDescription, payload: bytes) -> dict[str, pin.SE3]:
    """Each frame in the world, along the tree that is published."""
    waiting = list(DECODERS[decoder](payload).transforms)
    found = {world_frame(robot): pin.SE3.Identity()}
    while waiting:
        each = waiting.pop(0)
        assert (each.timestamp.sec, each.timestamp.nanosec) == divmod(STAMP, 1_000_000_000)
        if each.parent_frame_id in found:
            place = [getattr(each.translation, axis) for axis in "xyz"]
            turn = [getattr(each.rotation, axis) for axis in "xyzw"]
            pose = pin.XYZQUATToSE3(np.array([*place, *turn]))
            found[each.child_frame_id] = found[each.parent_frame_id] * pose
        else:
            waiting.append(each)
    return found


def samples(robot: RobotDescription, count: int = 20) -> np.ndarray:
    """Positions from the whole of its range."""
    return np.random.default_rng(1).uniform(*robot.sampling_range, (count, robot.n))


@pytest.mark.parametrize("decoder", DECODERS)
@pytest.mark.parametrize("name", ROBOTS)
def test_every_link_is_where_pinocchio_has_it_seen_from_the_base_frame(name, decoder):
    robot = ROBOTS[name]
    frames, built = FrameTransforms(robot), build_model(robot)
    for q in samples(robot):
        ours = published(decoder, robot, frames.pack(q, NOBODY, STAMP))
        theirs = by_pinocchio(built, q)
        assert ours.keys() - {world_frame(robot)} == theirs.keys()
        for link, placed in theirs.items():
            seen = theirs[robot.base_frame].actInv(placed)
            assert np.allclose(ours[link].homogeneous, seen.homogeneous, rtol=0.0, atol=1e-12), link


def test_a_free_base_carries_the_root_link():
    robot, q = ROBOTS["hoap3"], samples(ROBOTS["hoap3"], 1)[0]
    turn = pin.Quaternion(np.array([0.1, -0.2, 0.3, 0.9])).normalized()
    base = np.concatenate([[0.1, -0.2, 0.3], turn.coeffs(), np.ones(6)])
    ours = published("mcap", robot, FrameTransforms(robot).pack(q, base, STAMP))
    theirs = by_pinocchio(build_model(robot), q)
    root = pin.SE3(turn.matrix(), base[:3])
    for link, placed in theirs.items():
        seen = (root * placed).homogeneous
        assert np.allclose(ours[link].homogeneous, seen, rtol=0.0, atol=1e-12), link
