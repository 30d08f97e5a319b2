"""Frames of HOAP-3's own TCP protocol: encoder counts as doubles, without header or number.

A client first sends two doubles, the cycle time [ms] and the check time [s], which together say
how many exchanges follow. In an exchange each end sends one frame: 21 doubles, or 22 whose last
one means nothing. See docs/reference/wire.md.
"""

from __future__ import annotations

import math
import socket
import struct

import numpy as np

from hoap3.protocol.errors import DescriptionError, WireError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription

BEGINNING = struct.Struct("<2d")
LOST_MS = 6000  # without a sign of life from the other machine
LEAST, MOST = -32768.0, 32767.0  # of an int16


class Frames:
    """Frames of one robot.

    Args:
        description: of the robot, whose joints are the first slots in their order.
        slots: doubles in a frame.

    Attributes:
        size: of a frame [bytes].

    Raises:
        DescriptionError: a joint has no encoder scale, or there are more joints than slots.
    """

    def __init__(self, description: RobotDescription, slots: int) -> None:
        scales = description.counts_per_rad
        if scales is None:
            raise DescriptionError(
                f"robot {description.name!r}: a joint has no encoder_counts_per_rad, and HOAP-3's "
                "protocol carries counts. Add it to each joint, or write link.kind: zenoh"
            )
        if description.n > slots:
            raise DescriptionError(
                f"robot {description.name!r}: {description.n} joints, but frames of HOAP-3's "
                f"protocol have {slots} slots. Write link.kind: zenoh"
            )
        self._scales = scales
        self._slots = np.zeros(slots, "<f8")  # of the frame to be sent
        self._out, self._in = self._slots[: description.n], np.zeros(description.n)
        # as arrays, which a ufunc takes sooner than numbers
        self._least, self._most = np.full((2, description.n), [[LEAST], [MOST]])
        self.size = self._slots.nbytes

    def pack(self, positions: FloatArray) -> bytes:
        """Joint positions, (n,) [rad], as a frame: rounded to counts that an int16 can hold."""
        out = self._out
        np.multiply(positions, self._scales, out=out)
        np.rint(out, out=out)
        np.maximum(out, self._least, out=out)
        np.minimum(out, self._most, out=out)
        return self._slots.tobytes()

    def unpack(self, frame: bytes) -> FloatArray | None:
        """Joint positions of a frame, (n,) [rad]: each slot as the robot's int16 takes it.

        Returns:
            None where a joint's slot is no finite number. The array is used again by the next call.
        """
        counts, positions = np.frombuffer(frame, "<f8", len(self._in)), self._in
        if not all(map(math.isfinite, counts.tolist())):  # for so few faster than by numpy
            return None
        np.trunc(counts, out=positions)
        np.maximum(positions, self._least, out=positions)
        np.minimum(positions, self._most, out=positions)
        return np.divide(positions, self._scales, out=positions)


def set_up(connection: socket.socket) -> None:
    """Send each frame at once, and notice within some seconds that the other machine has gone."""
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, LOST_MS)  # while we send
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)  # while we do not
    for option in (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT):
        connection.setsockopt(socket.IPPROTO_TCP, option, 2)


def exchanges(beginning: bytes) -> int:
    """How many exchanges a client announces: the robot divides whole numbers.

    Raises:
        WireError: a time is no finite number, the cycle is shorter than 1 ms, there is no exchange,
            or the client, which divides doubles, counts another number.
    """
    cycle_ms, check_s = BEGINNING.unpack(beginning)
    given = f"CYCLE_TIME {cycle_ms:g} ms and CHECK_TIME {check_s:g} s"
    if not (math.isfinite(cycle_ms) and math.isfinite(check_s)):
        raise WireError("hoap3_tcp", f"{given}: both must be finite")
    if not (1.0 <= cycle_ms < 2**31 and 0.0 <= check_s < 2**31):
        raise WireError("hoap3_tcp", f"{given}: a cycle takes at least 1 ms, a check at least 0 s")
    number = int(check_s) * 1000 // int(cycle_ms)
    if number != int(check_s * 1000.0 / cycle_ms):
        raise WireError("hoap3_tcp", f"{given}: the two ends would count differently")
    if not number:
        raise WireError("hoap3_tcp", f"{given}: not one exchange")
    return number
