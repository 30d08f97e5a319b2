"""Messages of an earlier version of the wire as ones of today, and back.

A version only adds arrays behind those of the version before. So an older message is the begin of a
newer one, but for its version word, and becomes one by empty arrays at its end. What speaks with
peers or reads logs of an earlier version translates with these two; nothing else knows of it.
"""

from __future__ import annotations

import struct

from hoap3.protocol.messages import CDR_HEADER, Message, Setpoint, State, schema

OLDEST = 1
"""The earliest version that is still read."""

EARLIER = {cls: schema(cls.schema.name, f"v{OLDEST}") for cls in (State, Setpoint)}
"""Schemas of version 1, by the message of today."""
_BEHIND_VERSION = len(CDR_HEADER) + 4


def _head(version: int) -> bytes:
    return CDR_HEADER + struct.pack("<I", version)


_OLD = _head(OLDEST)
_NEW = {cls: _head(cls.schema.version) for cls in EARLIER}
_EMPTY = {
    cls: bytes(4 * (len(cls.schema.arrays) - len(old.arrays))) for cls, old in EARLIER.items()
}


def upgraded(message: type[Message], payload: bytes) -> bytes:
    """A payload of version 1 as one of today; any other as it is.

    What is malformed stays so.
    """
    if payload[:_BEHIND_VERSION] != _OLD or message not in EARLIER:
        return payload
    return _NEW[message] + payload[_BEHIND_VERSION:] + _EMPTY[message]


def downgraded(message: type[Message], payload: bytes) -> bytes:
    """A payload of today as one of version 1, which lacks the arrays that were added since.

    Raises:
        WireError: it ends before the last array of version 1.
    """
    if message not in EARLIER:
        return payload
    _, end = EARLIER[message].measure(payload)
    return _OLD + payload[_BEHIND_VERSION:end]
