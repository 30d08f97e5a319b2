"""Links are where Pinocchio has them; the message is read by two decoders."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from mcap_ros2._dynamic import generate_dynamic
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from support.robots.following_arm import following
from support.small_arm import arm

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.robot.pinocchio_model import RobotModel, build_model
from hoap3.robot_emulator.robots import load
from hoap3.tools.bridge.frame_transforms import SCHEMA, SCHEMA_NAME, FrameTransforms
from hoap3.tools.bridge.link_frames import LinkFrames, world_frame

ROBOTS = {
    "hoap3": load("hoap3"),
    "baxter": load("baxter_left_arm"),
    "arm": arm(),
    "followers": following(),
}
NOBODY = np.zeros(0)


def by_pinocchio(built: RobotModel, q: np.ndarray) -> dict[str, pin.SE3]:
    """Each link as seen from the root link."""
    ours = np.zeros(built.model.nq)
    ours[built.order] = built.followers.positions(q) if built.followers else q
    pin.framesForwardKinematics(built.model, built.data, ours)
    return {link: built.data.oMf[built.frames[link]].copy() for link in built.frames}


def chained(frames: LinkFrames, poses: np.ndarray) -> dict[str, pin.SE3]:
    """Each frame in the world, along the tree that is published."""
    waiting = list(zip(frames.parents, frames.children, poses, strict=True))
    found = {frames.parents[0]: pin.SE3.Identity()}
    while waiting:
        parent, child, pose = waiting.pop(0)
        if parent in found:
            found[child] = found[parent] * pin.XYZQUATToSE3(pose)
        else:
            waiting.append((parent, child, pose))
    return found


def samples(robot: RobotDescription, count: int = 20) -> np.ndarray:
    """Positions from the whole of its range."""
    return np.random.default_rng(1).uniform(*robot.sampling_range, (count, robot.n))


@pytest.mark.parametrize("name", ROBOTS)
def test_every_link_is_where_pinocchio_has_it_seen_from_the_base_frame(name: str) -> None:
    robot = ROBOTS[name]
    frames, built = LinkFrames(robot), build_model(robot)
    for q in samples(robot):
        ours, theirs = chained(frames, frames.poses(q, NOBODY)), by_pinocchio(built, q)
        assert ours.keys() - {world_frame(robot)} == theirs.keys()
        for link, placed in theirs.items():
            seen = theirs[robot.base_frame].actInv(placed)
            assert np.allclose(ours[link].homogeneous, seen.homogeneous, rtol=0.0, atol=1e-12), link


def test_a_free_base_carries_the_root_link() -> None:
    robot, q = ROBOTS["hoap3"], samples(ROBOTS["hoap3"], 1)[0]
    turn = pin.Quaternion(np.array([0.1, -0.2, 0.3, 0.9])).normalized()
    base = np.concatenate([[0.1, -0.2, 0.3], turn.coeffs(), np.ones(6)])
    frames = LinkFrames(robot)
    ours, theirs = chained(frames, frames.poses(q, base)), by_pinocchio(build_model(robot), q)
    root = pin.SE3(turn.matrix(), base[:3])
    for link, placed in theirs.items():
        seen = (root * placed).homogeneous
        assert np.allclose(ours[link].homogeneous, seen, rtol=0.0, atol=1e-12), link


def test_a_message_is_read_by_two_decoders() -> None:
    robot, stamp = ROBOTS["hoap3"], 1_700_000_000_123_456_789
    q, frames = samples(ROBOTS["hoap3"], 1)[0], LinkFrames(ROBOTS["hoap3"])
    payload = FrameTransforms(robot).pack(q, NOBODY, stamp)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(SCHEMA, SCHEMA_NAME))
    dynamic = generate_dynamic(SCHEMA_NAME, SCHEMA)[SCHEMA_NAME]
    for message in (store.deserialize_cdr(payload, SCHEMA_NAME), dynamic(payload)):
        assert tuple(each.parent_frame_id for each in message.transforms) == frames.parents
        assert tuple(each.child_frame_id for each in message.transforms) == frames.children
        read = [
            [getattr(part, axis) for part, axes in parts for axis in axes]
            for each in message.transforms
            for parts in [((each.translation, "xyz"), (each.rotation, "xyzw"))]
        ]
        assert read == frames.poses(q, NOBODY).tolist()
        assert {(each.timestamp.sec, each.timestamp.nanosec) for each in message.transforms} == {
            (1_700_000_000, 123_456_789)
        }
