"""What tests of both ends of HOAP-3's protocol share."""

from __future__ import annotations

import socket
import struct

from hoap3.protocol.link.hoap3_tcp.controller_link import Hoap3ControllerLink
from hoap3.protocol.messages import State

PATIENCE_S = 20.0
KINDS = [(order, slots) for order in ("paper", "legacy") for slots in (21, 22)]
"""Orders of an exchange, and numbers of slots in a frame."""


def cut(connection: socket.socket, end: str) -> None:
    """End a connection: close or reset it, or close the half that is written to."""
    if end == "reset":
        linger = struct.pack("ii", 1, 0)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
    if end == "half":
        connection.shutdown(socket.SHUT_WR)
    else:
        connection.close()


def taken(link: Hoap3ControllerLink) -> State:
    """The next State of a robot with 21 joints."""
    arrival = link.wait()
    assert arrival is not None
    state = State(21)
    state.load(arrival[1])
    return state
