"""A robot's joint states and description for ROS 2, as a node over rmw_zenoh publishes them.

No part of ROS is needed: the node is a Zenoh session of our own, apart from that to the robot,
with the keys, tokens and attachments of `rmw_zenoh`. It publishes; it takes nothing.
"""

from __future__ import annotations

import re
import time
from typing import Any

from hoap3.protocol.config.endpoints import endpoint_fault
from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.errors import ConfigError, LinkError, PortInUseError
from hoap3.protocol.messages import State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.tools.bridge.rmw_zenoh import Node, Publisher
from hoap3.tools.bridge.robot_feed import joint_states
from hoap3.tools.logs.log_format import JointStates, pack_string

NODE = "hoap3_bridge"
HEARTBEAT_S = 0.5  # between two words on what the newest description is, while it is new
_NAMESPACE = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)*")


class Ros2Publisher:
    """Publishes `joint_states` and `robot_description`: a `Viewer`.

    Args:
        listen: where ROS 2 nodes and routers find us; not beside `router`.
        router: the ROS 2 router that we connect to, and do not listen; None: we listen.
        domain: ROS_DOMAIN_ID.
        namespace: of the node and its topics, as `/robot1`; "" for none.

    Raises:
        ConfigError: an endpoint, a domain or a namespace that is none.
        PortInUseError: somebody listens there.
        LinkError: no router answers.
    """

    def __init__(self, listen: str, router: str | None, domain: int, namespace: str) -> None:
        if not _NAMESPACE.fullmatch(namespace):
            remedy = "Write it as ROS 2 does: /robot1"
            raise ConfigError("--namespace", "", namespace, "is no namespace", remedy)
        self._session = _open(listen, router)
        try:
            session = str(self._session.info.zid())
            node = Node(domain, session, namespace, NODE)
            states = node.publisher(1, "joint_states", "sensor_msgs/msg/JointState", depth=10)
            text = node.publisher(
                2, "robot_description", "std_msgs/msg/String", depth=1, latched=True
            )
            self._joint_states = _Topic(self._session, states, latched=False)
            self._description = _Topic(self._session, text, latched=True)
            tokens = [node.token, states.token, text.token]
            liveliness = self._session.liveliness()
            self._tokens = [liveliness.declare_token(token) for token in tokens]
        except BaseException:
            self._session.close()
            raise
        self._joints: JointStates | None = None
        self._text = b""

    def close(self) -> None:
        """Leave the network; ROS 2 sees that the node ends."""
        self._session.close()

    def begin(self, description: RobotDescription, endpoint: str) -> None:
        """Publish this robot's description, unless it is the one that was published last."""
        del endpoint
        self._joints = joint_states(description)
        text = pack_string(description.urdf)
        if text != self._text:
            self._description.publish(text, time.time_ns())
        self._text = text

    def state(self, payload: bytes, state: State) -> None:
        """Publish where the joints are; the stamp is of now, by the system's clock."""
        del state
        now = time.time_ns()
        joints = None if self._joints is None else self._joints.pack(payload, now)
        if joints is not None:
            self._joint_states.publish(joints, now)

    def setpoint(self, payload: bytes) -> None:
        """ROS 2 has no message for it."""

    def event(self, payload: bytes) -> None:
        """Likewise."""

    def idle(self) -> None:
        """Nothing waits."""

    def end(self) -> None:
        """The robot is gone: nothing is published until it comes again."""


class _Topic:
    """What is published on one topic, each message with its number.

    Of a latched one the last message is kept for who comes later, in the way that
    zenoh.ext.AdvancedPublisher and its subscribers have agreed on.
    """

    def __init__(self, session: Any, publisher: Publisher, *, latched: bool) -> None:
        from hoap3.protocol.link.zenoh_session import zenoh

        self._publisher, self._number = publisher, 0
        drop = zenoh.CongestionControl.DROP  # who takes nothing holds up nobody
        if latched:
            ext: Any = zenoh.ext
            self._to: Any = ext.declare_advanced_publisher(
                session,
                publisher.key,
                congestion_control=drop,
                cache=ext.CacheConfig(max_samples=1),
                sample_miss_detection=ext.MissDetectionConfig(
                    heartbeat=None, sporadic_heartbeat=HEARTBEAT_S
                ),
                publisher_detection=True,
            )
        else:
            self._to = session.declare_publisher(publisher.key, congestion_control=drop)

    def publish(self, payload: bytes, now: int) -> None:
        """Send a message, at a time since 1970 [ns]."""
        self._number += 1
        self._to.put(payload, attachment=self._publisher.attachment(self._number, now))


def _open(listen: str, router: str | None) -> Any:
    """A session of ROS 2's side."""
    from hoap3.protocol.link.zenoh_session import open_session

    option, place = ("--listen", listen) if router is None else ("--router", router)
    fault = endpoint_fault(place)
    if fault is not None:
        raise ConfigError(option, "", place, *fault)
    if router is not None:
        try:
            return open_session(LinkSettings(connect=(router,), mode="client"), stamps=True)
        except LinkError as error:
            raise LinkError(
                f"--router: nothing answers at {router}. Start one (`ros2 run rmw_zenoh_cpp "
                "rmw_zenohd`), or leave --router out: ROS 2 nodes then connect to the bridge"
            ) from error
    try:
        # Whoever reaches it reads what it publishes, and can command nothing.
        return open_session(LinkSettings(listen=(listen,), insecure=True), stamps=True)
    except PortInUseError as error:
        raise PortInUseError(
            f"--listen: {listen} is in use, by another bridge or a ROS 2 router. Stop it, give "
            f"--listen another port, or connect to that router: --router {listen}"
        ) from error
    except LinkError as error:
        raise ConfigError(
            "--listen", "", listen, "cannot be listened on", "Give an address of this machine"
        ) from error
