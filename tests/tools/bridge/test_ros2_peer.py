"""A ROS 2 peer that is not ours, zenoh-ros2-sdk, finds the bridge and receives from it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from looked_at import LookedAt, fed, until
from support.command_bench import endpoint
from support.small_arm import arm

from hoap3.tools.bridge.rmw_zenoh import TYPES
from hoap3.tools.bridge.ros2_publisher import Ros2Publisher

pytestmark = pytest.mark.slow

ROBOT = arm()
DEFINITIONS = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "std_msgs/msg/String": "string data\n",
    "sensor_msgs/msg/JointState": (
        "std_msgs/Header header\n\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
        "float64[] effort\n"
    ),
}
"""What a ROS 2 installation has under `share/`, as far as it is needed."""


@pytest.fixture
def bridge() -> Iterator[tuple[Ros2Publisher, int]]:
    """A bridge, and its port."""
    at = endpoint()
    publisher = Ros2Publisher(at, None, 0, "")
    yield publisher, int(at.rpartition(":")[2])
    publisher.close()


@pytest.fixture
def peer(
    bridge: tuple[Ros2Publisher, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Any]:
    """The library, connected to the bridge, with a registry of these types alone."""
    import zenoh_ros2_sdk
    from zenoh_ros2_sdk.message_registry import get_registry
    from zenoh_ros2_sdk.session import ZenohSession

    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    session = ZenohSession.get_instance("127.0.0.1", bridge[1])
    for name, text in DEFINITIONS.items():
        path = tmp_path / f"{name}.msg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr(get_registry(), "messages_dir", tmp_path)
    yield zenoh_ros2_sdk
    session.session.close()
    ZenohSession._instance = None


def test_it_receives_joint_states(bridge, peer):
    at, seen = endpoint(), list[Any]()
    q = ROBOT.initial_position + 0.1
    subscriber = peer.ROS2Subscriber("/joint_states", "sensor_msgs/msg/JointState", seen.append)
    with LookedAt(ROBOT, at) as robot, fed(bridge[0], lambda: (ROBOT.name, at)):
        until(lambda: len(seen) > 2, lambda: robot.say(robot.state(q=q, tau=2.0)))
    subscriber.close()
    for message in seen:
        assert tuple(message.name) == ROBOT.joint_names
        assert message.position.tolist() == q.tolist()
        assert message.effort.tolist() == [2.0] * ROBOT.n
        assert message.header.stamp.sec > 0


def test_it_receives_the_description_though_it_comes_later(bridge, peer):
    from zenoh_ros2_sdk.qos import QosDurability, QosProfile

    at, seen = endpoint(), list[Any]()
    latched = QosProfile(durability=QosDurability.TRANSIENT_LOCAL, history_depth=1)
    with LookedAt(ROBOT, at), fed(bridge[0], lambda: (ROBOT.name, at)) as told:
        until(lambda: told)
        subscriber = peer.ROS2Subscriber(
            "/robot_description", "std_msgs/msg/String", seen.append, qos=latched
        )
        until(lambda: seen)
        subscriber.close()
    assert {message.data for message in seen} == {ROBOT.urdf}


def test_it_finds_the_topics_their_types_and_the_node(bridge, peer):
    here = {"router_ip": "127.0.0.1", "router_port": bridge[1]}
    found = until(lambda: dict(peer.get_topic_names_and_types(**here)))
    assert found == {
        "/joint_states": ["sensor_msgs/msg/JointState"],
        "/robot_description": ["std_msgs/msg/String"],
    }
    told = peer.get_topic_info("/joint_states", verbose=True, **here)
    (publisher,) = told.publishers
    assert publisher.node_name == "hoap3_bridge"
    assert publisher.type_hash == TYPES["sensor_msgs/msg/JointState"].rpartition("/")[2]
    assert told.subscriber_count == 0
