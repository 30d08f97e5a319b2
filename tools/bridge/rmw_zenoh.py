"""Keys, liveliness tokens and attachments of rmw_zenoh_cpp, ROS 2 over Zenoh.

As its design says (https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md): a topic is the
key `<domain>/<name>/<type>/<hash of the type>`; each node and each publisher holds a liveliness
token, from whose key others learn what there is; and behind each message come its number, the
time at which it was sent and the publisher's GID.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property

import xxhash

TYPES = {
    "sensor_msgs/msg/JointState": (
        "sensor_msgs::msg::dds_::JointState_/"
        "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
    ),
    "std_msgs/msg/String": (
        "std_msgs::msg::dds_::String_/"
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    ),
}
"""DDS name and REP-2016 hash of each published type, as `ros2 topic info --verbose` prints them."""

_SPACE = "@ros2_lv"
_ATTACHMENT = struct.Struct("<qqB16s")


@dataclass(frozen=True)
class Node:
    """A ROS 2 node.

    Attributes:
        domain: ROS_DOMAIN_ID.
        session: id of its Zenoh session.
        namespace: as `/robot1`, or "".
        name: within it.
    """

    domain: int
    session: str
    namespace: str
    name: str

    @property
    def token(self) -> str:
        """Key of its liveliness token."""
        return self._head(0, "NN")

    def _head(self, entity: int, kind: str) -> str:
        where = f"{_SPACE}/{self.domain}/{self.session}/0/{entity}/{kind}"
        return f"{where}/%/{mangled(self.namespace)}/{self.name}"

    def publisher(
        self, entity: int, topic: str, kind: str, *, depth: int, latched: bool = False
    ) -> Publisher:
        """A publisher of it.

        Args:
            entity: its number, from 1; no other of the node has it.
            topic: its name within the namespace.
            kind: its type, one of `TYPES`.
            depth: how many of its last messages it keeps; it is reliable.
            latched: whether late subscribers receive these (`transient_local`).
        """
        full = f"{self.namespace}/{topic}"
        what = TYPES[kind]
        qos = f":{1 if latched else ''}:,{depth}:,:,:,,"  # what is empty has the default
        token = f"{self._head(entity, 'MP')}/{mangled(full)}/{what}/{qos}"
        return Publisher(f"{self.domain}{full}/{what}", token)


@dataclass(frozen=True)
class Publisher:
    """A publisher of a ROS 2 node.

    Attributes:
        key: that it publishes on.
        token: key of its liveliness token.
    """

    key: str
    token: str

    @cached_property
    def gid(self) -> bytes:
        """By which others know it, 16 bytes."""
        return xxhash.xxh3_128_intdigest(self.token.encode()).to_bytes(16, "little")

    def attachment(self, number: int, stamp: int) -> bytes:
        """What comes with a message.

        Args:
            number: of the message, from 1.
            stamp: when it was sent, since 1970 [ns].
        """
        return _ATTACHMENT.pack(number, stamp, 16, self.gid)


def mangled(name: str) -> str:
    """A name as one part of a key."""
    return name.replace("/", "%") or "%"
