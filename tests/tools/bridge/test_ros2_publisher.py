"""A ROS 2 peer sees a robot on a real Zenoh session: its node, its topics, its messages."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import pytest
import xxhash
import zenoh
from looked_at import LookedAt, fed, until
from mcap_ros2._dynamic import generate_dynamic
from support.command_bench import endpoint
from support.small_arm import arm

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.errors import ConfigError, LinkError, PortInUseError
from hoap3.protocol.link.zenoh_session import open_session
from hoap3.tools.bridge.rmw_zenoh import TYPES
from hoap3.tools.bridge.ros2_publisher import Ros2Publisher
from hoap3.tools.logs.log_format import JOINT_STATE, unpack_string

ROBOT = arm()
JOINTS, STRING = TYPES["sensor_msgs/msg/JointState"], TYPES["std_msgs/msg/String"]


@contextmanager
def published(
    domain: int = 0, namespace: str = ""
) -> Iterator[tuple[Ros2Publisher, zenoh.Session, str]]:
    """A bridge, and a peer that is connected to it, at an endpoint."""
    at = endpoint()
    with (
        closing(Ros2Publisher(at, None, domain, namespace)) as publisher,
        open_session(LinkSettings(connect=(at,)), stamps=True) as peer,
    ):
        yield publisher, peer, at


def tokens(peer: zenoh.Session) -> list[str]:
    """Of all nodes and publishers that the peer sees."""
    replies = peer.liveliness().get("@ros2_lv/**", timeout=2.0)
    return sorted(str(reply.ok.key_expr) for reply in replies if reply.ok)


def test_joint_states_come_with_number_stamp_and_gid() -> None:
    at, seen = endpoint(), list[Any]()
    q = ROBOT.initial_position + 0.1
    with published() as (publisher, peer, _), LookedAt(ROBOT, at) as robot:
        peer.declare_subscriber(f"0/joint_states/{JOINTS}", seen.append)
        with fed(publisher, lambda: (ROBOT.name, at)):
            until(lambda: len(seen) > 4, lambda: robot.say(robot.state(q=q, dq=0.5)))
        token = next(each for each in tokens(peer) if "%joint_states" in each)
    read = generate_dynamic("sensor_msgs/msg/JointState", JOINT_STATE)["sensor_msgs/msg/JointState"]
    before = 0
    for number, sample in enumerate(seen, seen_number(seen[0])):
        message = read(sample.payload.to_bytes())
        assert tuple(message.name) == ROBOT.joint_names
        assert list(message.position) == q.tolist()
        assert list(message.velocity) == [0.5] * ROBOT.n
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        counted, sent, size, gid = struct.unpack("<qqB16s", sample.attachment.to_bytes())
        assert (counted, sent, size) == (number, stamp, 16)
        assert before < stamp <= time.time_ns()
        before = stamp
    assert len({sample.attachment.to_bytes()[17:] for sample in seen}) == 1
    assert token.startswith("@ros2_lv/0/")
    assert gid == xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


def seen_number(sample: Any) -> int:
    """Number of a message."""
    return int(struct.unpack_from("<q", sample.attachment.to_bytes())[0])


def test_node_and_publishers_are_alive_until_the_bridge_ends() -> None:
    with published(3, "/robot1") as (publisher, peer, _):
        node, joints, description = until(lambda: len(found := tokens(peer)) == 3 and found)
        session = node.split("/")[2]
        here = f"@ros2_lv/3/{session}/0"
        name = "%/%robot1/hoap3_bridge"
        assert node == f"{here}/0/NN/{name}"
        assert joints == f"{here}/1/MP/{name}/%robot1%joint_states/{JOINTS}/::,10:,:,:,,"
        assert description == f"{here}/2/MP/{name}/%robot1%robot_description/{STRING}/:1:,1:,:,:,,"
        publisher.close()
        until(lambda: not tokens(peer))


def test_who_comes_later_is_given_the_description() -> None:
    at, key = endpoint(), f"0/robot_description/{STRING}"
    with (
        published() as (publisher, peer, _),
        LookedAt(ROBOT, at),
        fed(publisher, lambda: (ROBOT.name, at)) as told,
    ):
        until(lambda: told)
        for _ in range(2):  # as rmw_zenoh subscribes with transient_local
            seen: list[Any] = []
            history: Any = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
            subscriber: Any = zenoh.ext.declare_advanced_subscriber(
                peer, key, seen.append, history=history
            )
            (sample,) = until(lambda seen=seen: seen)
            assert unpack_string(sample.payload.to_bytes()) == ROBOT.urdf
            assert seen_number(sample) == 1
            subscriber.undeclare()
        replies = peer.liveliness().get(f"{key}/@adv/pub/**", timeout=2.0)
        assert any(reply.ok for reply in replies)  # by which subscribers find one that comes later


def test_an_endpoint_that_is_taken_is_told_with_what_to_do() -> None:
    with published() as (_, _, at), pytest.raises(PortInUseError, match=rf"--listen.*{at}"):
        Ros2Publisher(at, None, 0, "")


@pytest.mark.parametrize(
    ("given", "option"),
    [
        (("127.0.0.1:7448", None, 0, ""), "--listen"),
        (("tcp/127.0.0.1:7448", "nowhere", 0, ""), "--router"),
        (("tcp/192.0.2.1:7448", None, 0, ""), "--listen"),
        (("tcp/127.0.0.1:7448", None, 0, "robot1"), "--namespace"),
        (("tcp/127.0.0.1:7448", None, 0, "/a/*"), "--namespace"),
    ],
)
def test_what_is_no_place_or_name_is_refused(given: Any, option: str) -> None:
    with pytest.raises(ConfigError, match=option):
        Ros2Publisher(*given)


@pytest.mark.slow
def test_a_router_that_is_not_there_is_told() -> None:
    with pytest.raises(LinkError, match="--router"):
        Ros2Publisher("", endpoint(), 0, "")
