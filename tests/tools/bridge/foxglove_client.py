"""A client of Foxglove's WebSocket protocol that is not Foxglove's, and decoders that are not ours.

The protocol: https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable
from typing import Any, Self

from mcap_ros2._dynamic import generate_dynamic
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from websockets.sync.client import connect
from websockets.typing import Subprotocol

PATIENCE_S = 20.0
_MESSAGE = 1  # opcode of a message, either way


class FoxgloveClient:
    """Connected to a server.

    Attributes:
        info: what the server said of itself.
        channels: by topic.
        messages: raw ones, by topic, in order, of channels that are there.
        status: what the server said to people.
    """

    def __init__(self, port: int) -> None:
        self._socket = connect(
            f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None
        )
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.messages: dict[str, list[bytes]] = {}
        self.status: list[str] = []
        self._wanted = False
        self._topics: dict[int, str] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def look_at_all(self) -> None:
        """Subscribe to all there is, and all that is still to come."""
        self._wanted = True
        self.look_at(list(self.channels.values()))

    def look_at(self, channels: list[dict[str, Any]]) -> None:
        """Subscribe to these, as they were told."""
        self._topics.update({channel["id"]: channel["topic"] for channel in channels})
        wanted = [{"id": channel["id"], "channelId": channel["id"]} for channel in channels]
        self._tell(op="subscribe", subscriptions=wanted)

    def advertise(self, topic: str, schema: str, encoding: str = "json", number: int = 1) -> None:
        """Say that we will publish."""
        channel = {"id": number, "topic": topic, "encoding": encoding, "schemaName": schema}
        self._tell(op="advertise", channels=[channel])

    def publish(self, content: Any, number: int = 1) -> None:
        """Publish: bytes, or what becomes JSON."""
        data = content if isinstance(content, bytes) else json.dumps(content).encode()
        self._socket.send(struct.pack("<BI", _MESSAGE, number) + data)

    def wait_for(self, true: Callable[[], Any], again: Callable[[], object] = lambda: None) -> None:
        """Take what comes until something is true."""
        for _ in range(int(PATIENCE_S / 0.02)):
            if true():
                return
            again()
            try:
                while not true():
                    self._take(self._socket.recv(timeout=0.02))
            except TimeoutError:
                continue
        raise AssertionError(f"did not hear it; status {self.status}, {sorted(self.messages)}")

    def drop(self) -> None:
        """End without a word."""
        self._socket.socket.close()

    def decoded(self, topic: str) -> list[Any]:
        """The messages of a topic, read by mcap-ros2-support with the schema that was told."""
        return [self._reader(topic)(payload) for payload in self.messages[topic]]

    def decoded_newest(self, topic: str) -> Any:
        """The newest of them."""
        return self._reader(topic)(self.messages[topic][-1])

    def _reader(self, topic: str) -> Any:
        channel = self.channels[topic]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
        name = channel["schemaName"]
        return generate_dynamic(name, channel["schema"])[name]

    def decoded_by_rosbags(self, topic: str) -> list[Any]:
        """Likewise by rosbags, another decoder."""
        channel, store = self.channels[topic], get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(channel["schema"], channel["schemaName"]))
        kind = channel["schemaName"]
        return [store.deserialize_cdr(payload, kind) for payload in self.messages[topic]]

    def _tell(self, **content: Any) -> None:
        self._socket.send(json.dumps(content))

    def _take(self, message: str | bytes) -> None:
        if isinstance(message, bytes):
            opcode, number, _ = struct.unpack_from("<BIQ", message)
            if opcode == _MESSAGE:
                self.messages.setdefault(self._topics[number], []).append(message[13:])
            return
        content = json.loads(message)
        match content["op"]:
            case "serverInfo":
                self.info = content
            case "advertise":
                self.channels.update({each["topic"]: each for each in content["channels"]})
                if self._wanted:
                    self.look_at(content["channels"])
            case "unadvertise":
                gone = set(content["channelIds"])
                for topic in [t for t, c in self.channels.items() if c["id"] in gone]:
                    del self.channels[topic]
                    self.messages.pop(topic, None)
            case "status":
                self.status.append(content["message"])
                self._look_again(content["message"])

    def _look_again(self, status: str) -> None:
        """Subscribe once more to a channel that is there, but that the server did not know yet.

        foxglove-sdk 0.30.3 tells of a new channel before it takes subscriptions to it.
        """
        if (unknown := re.search(r"Unknown channel ID: (\d+)", status)) is not None:
            number = int(unknown[1])
            self.look_at([each for each in self.channels.values() if each["id"] == number])
