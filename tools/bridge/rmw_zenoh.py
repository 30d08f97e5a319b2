"""How rmw_zenoh_cpp, ROS 2 over Zenoh, names things, and what it attaches to messages.

As its design says (https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md): a topic is the
key `<domain>/<name>/<type>/<hash of the type>`; each node and each publisher holds a liveliness
token, from whose key others learn what there is; and behind each message come its number, the
time at which it was sent and the publisher's GID. Only names are made here.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property

import xxhash

from hoap3.tools.bridge.type_hashes import dds_name, type_hash

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

    def publisher(self, entity: int, topic: str, kind: str, text: str, qos: Qos) -> Publisher:
        """A publisher of it.

        Args:
            entity: its number, from 1; no other of the node has it.
            topic: its name within the namespace.
            kind: its type, as `std_msgs/msg/String`.
            text: `ros2msg` schema of the type.
            qos: what it offers.
        """
        full = f"{self.namespace}/{topic}"
        what = f"{dds_name(kind)}/{type_hash(kind, text)}"
        token = f"{self._head(entity, 'MP')}/{mangled(full)}/{what}/{qos.compact}"
        return Publisher(f"{self.domain}{full}/{what}", token)


@dataclass(frozen=True)
class Qos:
    """What a reliable publisher that keeps its last messages offers.

    Attributes:
        depth: how many it keeps.
        latched: whether who comes later is given them (`transient_local`).
    """

    depth: int
    latched: bool = False

    @property
    def compact(self) -> str:
        """As it stands in a token; what is empty has the default."""
        return f":{1 if self.latched else ''}:,{self.depth}:,:,:,,"


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
