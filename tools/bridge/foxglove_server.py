"""A server for Foxglove: a robot's messages as they are logged, its description and its frames.

Topics, types and bytes are those of a log, so that one layout serves both. A slow client loses the
oldest messages in its queue; the server never waits for a client.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from hoap3.protocol.errors import ConfigError, NotInstalledError, PortInUseError
from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.tools.bridge.frame_transforms import SCHEMA, SCHEMA_NAME, FrameTransforms
from hoap3.tools.bridge.panel_targets import PanelTargets
from hoap3.tools.bridge.robot_feed import joint_states
from hoap3.tools.logs.log_format import JOINT_STATE, STRING, pack_string, topic_name

HOST, PORT = "127.0.0.1", 8765
DESCRIPTION_TOPIC, FRAMES_TOPIC = "/robot_description", "/tf"
BACKLOG = 256  # queued messages for one client; about 60 are sent per second on each topic
_LIVE = {
    "state": (State.schema.ros_name, State.schema.text),
    "setpoint": (Setpoint.schema.ros_name, Setpoint.schema.text),
    "events": (Event.schema.ros_name, Event.schema.text),
    "joint_states": ("sensor_msgs/msg/JointState", JOINT_STATE),
}
"""Topics of a robot, as in a log: type and schema."""


def check_foxglove() -> None:
    """Check that foxglove-sdk is installed.

    Raises:
        NotInstalledError: foxglove-sdk is not installed.
    """
    if find_spec("foxglove") is None:
        raise NotInstalledError("package", "foxglove-sdk", "'hoap3[foxglove]'")


class FoxgloveServer:
    """Shows a robot to clients of Foxglove: a `Viewer`.

    Args:
        host, port: where it listens; port 0: a free one.
        steer: whether messages that panels publish become targets; else clients cannot publish.
        report: receives the results of that, which clients see as status messages.

    Attributes:
        port: where it listens.

    Raises:
        NotInstalledError: foxglove-sdk is not installed.
        ConfigError: no such address.
        PortInUseError: the port is in use.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        steer: bool = False,
        report: Callable[[str], None] = lambda _: None,
    ) -> None:
        check_foxglove()
        import foxglove
        from foxglove.websocket import Capability

        # It would log through Python by threads that hold its locks, such as of the channels where
        # a client asks for one that is gone; if we close a channel then, both wait for ever.
        foxglove.set_log_level("CRITICAL")
        self._foxglove, self._report = foxglove, report
        self._targets: PanelTargets | None = None
        listener: Any = self  # of the methods of theirs those that are asked for
        self._context = foxglove.Context()
        self._channels: dict[str, Any] = {}
        self._published: dict[tuple[int, int], tuple[str, str, str]] = {}
        self._describe = threading.Event()
        self._text = b""
        try:
            self._server = foxglove.start_server(
                name="hoap3",
                host=host,
                port=port,
                context=self._context,
                capabilities=[Capability.ClientPublish] if steer else [],
                supported_encodings=["json", "cdr"] if steer else None,
                server_listener=listener,
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:
            if "in use" in str(error):
                raise PortInUseError(
                    f"{host}:{port} is in use: another bridge runs there, or Foxglove's own. Stop "
                    "it, or give --port another number (0: any that is free)"
                ) from error
            remedy = "Give an address of this machine, such as 127.0.0.1"
            raise ConfigError(
                "--host", "", host, f"cannot listen there ({error})", remedy
            ) from error
        self.port = int(self._server.port)
        if steer:
            self._targets = PanelTargets(self._tell)

    def close(self) -> None:
        """Release the operator role and disconnect all clients."""
        if self._targets is not None:
            self._targets.close()
        self._server.stop()

    def _tell(self, words: str) -> None:
        """Report a message, and send it to all clients as a status."""
        self._report(words)
        self._server.publish_status(words, self._foxglove.StatusLevel.Warning)

    def begin(self, description: RobotDescription, endpoint: str) -> None:
        """Create the topics of this robot in place of those of the last one."""
        if self._targets is not None:
            self._targets.begin(description, endpoint)
        for channel in self._channels.values():
            channel.close()
        self._server.clear_session()
        topics = {leaf: (topic_name(description.name, leaf), *what) for leaf, what in _LIVE.items()}
        topics["description"] = (DESCRIPTION_TOPIC, "std_msgs/msg/String", STRING)
        topics["frames"] = (FRAMES_TOPIC, SCHEMA_NAME, SCHEMA)
        self._channels = {leaf: self._channel(*what) for leaf, what in topics.items()}
        self._frames = FrameTransforms(description)
        self._joints = joint_states(description)
        self._text = pack_string(description.urdf)

    def state(self, payload: bytes, state: State) -> None:
        """Publish a State, the joint states and the frames of the links."""
        now = time.time_ns()
        self._log("state", payload, now)
        joints = self._joints.pack(payload, now)
        if joints is not None:
            self._log("joint_states", joints, now)
        if self._channels["frames"].has_sinks():
            self._log("frames", self._frames.pack(state.q, state.base, now), now)

    def setpoint(self, payload: bytes) -> None:
        """Publish a Setpoint."""
        self._log("setpoint", payload, time.time_ns())

    def event(self, payload: bytes) -> None:
        """Publish an Event."""
        self._log("events", payload, time.time_ns())

    def idle(self) -> None:
        """Publish the robot's description where a client has subscribed to it since."""
        if self._describe.is_set() and self._channels:
            self._describe.clear()
            self._log("description", self._text, time.time_ns())

    def end(self) -> None:
        """Tell clients that the robot is gone; its last messages stay on the screen."""
        self._server.publish_status(
            "the robot is gone, or starts again", self._foxglove.StatusLevel.Warning
        )

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Callback of Foxglove, in its own thread: a client subscribes to a topic."""
        del client
        if channel.topic == DESCRIPTION_TOPIC:
            self._describe.set()

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Callback of Foxglove: a client unsubscribes."""

    def on_client_advertise(self, client: Any, channel: Any) -> None:
        """Callback of Foxglove: a client announces a channel of its own."""
        what = channel.topic, channel.schema_name, channel.encoding
        self._published[client.id, channel.id] = what

    def on_client_unadvertise(self, client: Any, client_channel_id: int) -> None:
        """Callback of Foxglove: a client closes a channel; with the last one steering ends."""
        self._published.pop((client.id, client_channel_id), None)
        if self._targets is not None and not self._published:
            self._targets.release()

    def on_message_data(self, client: Any, client_channel_id: int, data: bytes) -> None:
        """Callback of Foxglove: a client has published a message."""
        what = self._published.get((client.id, client_channel_id))
        if self._targets is not None and what is not None:
            self._targets.take((*what, data))

    def _channel(self, topic: str, name: str, text: str) -> Any:
        schema = self._foxglove.Schema(name=name, encoding="ros2msg", data=text.encode())
        return self._foxglove.Channel(
            topic, schema=schema, message_encoding="cdr", context=self._context
        )

    def _log(self, leaf: str, payload: bytes, now: int) -> None:
        self._channels[leaf].log(payload, log_time=now)
