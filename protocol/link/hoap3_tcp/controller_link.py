"""The controller's side of HOAP-3's own TCP protocol, in place of Zenoh.

The wire has positions only. What else a State has is made here: its tick counts the frames, its
velocities are differences, and its reference is what was commanded last, in double: rounding to
counts never adds up.
"""

from __future__ import annotations

import contextlib
import json
import secrets
import select
import socket
import threading
import time

import numpy as np

from hoap3.protocol.config.settings import Hoap3TcpSettings
from hoap3.protocol.link.base import Arrival, Request
from hoap3.protocol.link.hoap3_tcp.frames import BEGINNING, Frames, set_up
from hoap3.protocol.messages import FloatArray, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription

CONNECT_S = 2.0  # for the port of the frames, which HOAP-3 opens after the beginning
PAUSE_S = 0.05
SENT_AWAY_S = 0.1  # in which a robot that has another client closes the first connection
EPOCH = 1  # the protocol has none: who is connected is followed


class Hoap3ControllerLink:
    """A client of one robot.

    Args:
        description: of the robot, which the protocol does not tell.
        settings: ports, order and size of frames.
        who: name of the controller.

    Attributes:
        presence: set while it is connected.
        departures: how often the robot went away.
        linked: whether it was ever connected.

    Raises:
        DescriptionError: the robot's positions do not fit into frames.
    """

    def __init__(self, description: RobotDescription, settings: Hoap3TcpSettings, who: str) -> None:
        self.robot, self.who, self.session_id = description.name, who, -1
        self.presence, self.departures, self.linked = threading.Event(), 0, False
        self._description, self._settings = description, settings
        self._frames, self._setpoint = Frames(description, settings.slots), Setpoint(description.n)
        self._per_period = 1.0 / description.period_s
        self._state = State.allocate(**description.state_lengths)
        self._woken, self._waker = socket.socketpair()
        self._poll = select.poll()
        self._poll.register(self._woken, select.POLLIN)
        self._beginning: socket.socket | None = None  # the first connection, silent so far
        self._connection: socket.socket | None = None
        self._session = 0
        self._part = b""
        self._answered = True

    def wait(self) -> Arrival | None:
        """Block until a frame is there; None where the robot has gone, or when woken.

        A frame that the controller was silent about is answered first: with the last reference.
        """
        connection = self._connection
        if connection is not None and not self._answered:
            self._send(self._state.reference)
            connection = self._connection  # None where it has gone
            if connection is None:
                return None
        woken, poll = self._woken.fileno(), self._poll.poll
        while True:
            ready = poll()
            if ready[0][0] == woken or len(ready) > 1:
                self._woken.recv(64)
                return None
            if connection is not None and not self._receive(connection):
                self._lose()
                return None
            if len(self._part) == self._frames.size:
                stamp = time.monotonic_ns()
                state = self._as_state(stamp)
                if state is None:  # without us the robot stops
                    self._lose()
                    return None
                return stamp, state

    def publish(self, setpoint: bytes) -> None:
        """Send the positions of a Setpoint, and remember them as the reference."""
        answer = self._setpoint
        if len(setpoint) != answer.size:
            answer = self._setpoint = Setpoint.like(setpoint)
        answer.load(setpoint)
        self._state.reference[:] = answer.values
        self._send(answer.values)

    def wake(self) -> None:
        """Make `wait` return None; from any thread."""
        with contextlib.suppress(OSError):
            self._waker.send(b"\0")

    def ask(self, verb: str, body: bytes = b"") -> bytes | None:
        """What a robot would answer over Zenoh; None where it cannot be reached."""
        del body
        if verb == "description":
            return self._description.to_json() if self._reach() else None
        if verb == "release":
            self._disconnect()
            return json.dumps({"released": True}).encode()
        if verb == "acquire" and self._connection is None and not self._connect():
            return None
        if verb == "acquire":
            return self._status(granted=True, epoch=EPOCH, from_tick=0)
        if verb == "status" and self._connection is None:
            self._session = secrets.randbits(63)
        return self._status()

    def _status(self, **more: object) -> bytes:
        connected = self._connection is not None
        status = {
            "mode": "active" if connected else "idle",
            "holder": self.who if connected else None,
            "session_id": self._session,
            "tick": 0,
            "lockstep": False,
        }
        return json.dumps({**status, **more}).encode()

    def request(self) -> Request | None:
        """Nothing: nobody asks a controller over this protocol."""

    def event(self) -> bytes | None:
        """Nothing: the protocol has no events."""

    def target(self) -> tuple[str, bytes] | None:
        """Nothing: the protocol has no targets."""

    def vanished(self) -> str | None:
        """Nobody: the protocol has no clients but us."""

    def close(self) -> None:
        """Leave the robot."""
        self._disconnect()
        if self._beginning is not None:
            self._beginning.close()
        self._woken.close()
        self._waker.close()

    def _reach(self) -> bool:
        """Open the first connection: while it is silent, the robot waits for us.

        A robot that has another client closes it at once, and any after some seconds.
        """
        if self._connection is not None:
            return True
        if self._beginning is not None and _has_ended(self._beginning, 0.0):
            self._beginning.close()
            self._beginning = None
        if self._beginning is None:
            address = self._settings.host, self._settings.init_port
            with contextlib.suppress(OSError):
                beginning = socket.create_connection(address, CONNECT_S)
                if _has_ended(beginning, SENT_AWAY_S):
                    beginning.close()
                else:
                    self._beginning = beginning
        return self._beginning is not None

    def _connect(self) -> bool:
        """Say how long, and open the second connection, which stays."""
        self._reach()
        beginning, self._beginning = self._beginning, None
        if beginning is None:
            return False
        cycle_ms = max(1.0, round(self._description.period_s * 1e3))
        with beginning, contextlib.ExitStack() as undo:
            try:
                beginning.sendall(BEGINNING.pack(cycle_ms, float(self._settings.check_s)))
                connection = undo.enter_context(self._second_connection())
                set_up(connection)
                if self._settings.order == "legacy":
                    connection.sendall(self._frames.pack(self._description.initial_position))
            except OSError:
                return False
            undo.pop_all()
        connection.setblocking(False)  # `wait` knows what is there, and there is room for an answer
        self._connection, self._part, self._answered = connection, b"", True
        self._poll.register(connection, select.POLLIN)
        state, start = self._state, self._description.initial_position
        state.session_id, state.tick = self._session, 0
        state.mode, state.epoch = State.ACTIVE, EPOCH
        state.stamp_published = state.stamp_sent_previous = 0
        state.q[:], state.reference[:], state.dq[:] = start, start, 0.0
        self.linked = True
        self.presence.set()
        return True

    def _second_connection(self) -> socket.socket:
        """The connection for frames; HOAP-3 opens that port only when it has read the beginning.

        Raises:
            OSError: there is none in time.
        """
        address, until = (self._settings.host, self._settings.control_port), time.monotonic()
        until += CONNECT_S
        while True:
            try:
                return socket.create_connection(address, CONNECT_S)
            except ConnectionRefusedError:
                if time.monotonic() > until:
                    raise
                time.sleep(PAUSE_S)

    def _send(self, positions: FloatArray) -> None:
        self._answered = True
        if self._connection is not None:
            try:
                whole = self._connection.send(self._frames.pack(positions)) == self._frames.size
            except OSError:  # such as of a robot that has not read for long
                whole = False
            if not whole:
                self._lose()

    def _receive(self, connection: socket.socket) -> bool:
        """Take what has arrived of a frame; False where the robot has gone."""
        try:
            data = connection.recv(self._frames.size - len(self._part))
        except OSError:
            return False
        self._part += data
        return bool(data)

    def _as_state(self, stamp: int) -> bytes | None:
        """The frame that has arrived, as a State; None where a position is no finite number."""
        state, before = self._state, self._state.stamp_published
        positions = self._frames.unpack(self._part)
        self._part, self._answered = b"", False
        if positions is None:
            return None
        if before:
            state.tick += 1
            np.subtract(positions, state.q, out=state.dq)
            np.multiply(state.dq, self._per_period, out=state.dq)
        else:
            state.reference[:] = positions
        state.q[:] = positions
        state.stamp_intended = state.stamp_actual = state.stamp_published = stamp
        state.stamp_sent_previous = before
        return state.dump()

    def _lose(self) -> None:
        self.departures += 1
        self._disconnect()

    def _disconnect(self) -> None:
        connection, self._connection = self._connection, None
        self.presence.clear()
        if connection is not None:
            self._poll.unregister(connection)
            connection.close()


def _has_ended(connection: socket.socket, seconds: float) -> bool:
    """Whether a robot that says nothing there closes it within that time [s]."""
    return bool(select.select((connection,), (), (), seconds)[0])
