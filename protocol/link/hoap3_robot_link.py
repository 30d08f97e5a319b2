"""The robot's side of HOAP-3's own TCP protocol, in place of Zenoh.

A client that has connected is the holder of authority. While the robot follows it, each State is
sent as a frame of encoder counts, and the client's frames answer them in the order in which they
were sent: nothing else says which belongs to which.
"""

from __future__ import annotations

import contextlib
import errno
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from hoap3.protocol.config.settings import Hoap3TcpSettings
from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import LinkError, PortInUseError, WireError
from hoap3.protocol.link.base import Arrival, Request
from hoap3.protocol.link.hoap3_client_connection import ClientConnection
from hoap3.protocol.link.hoap3_frames import BEGINNING, Frames, exchanges, set_up
from hoap3.protocol.link.local_control import LocalControl
from hoap3.protocol.messages import Setpoint, State, schema

FIFO = 8  # States that wait for their answers; further ones are not sent: an overrun
BACKLOG = 1024  # frames that the loop has not taken; of more the oldest are dropped
LOOK_MS = 100  # how often the thread looks whether the link was closed
PATIENCE_S = 10.0  # for the 16 bytes of the beginning, before which a controller is built
CONNECT_S = 5.0  # from these to the connection on the other port

NO_CERTIFICATE = schema("Setpoint").constants["STATUS_NONE"]


class Hoap3RobotLink:
    """A server with one client at a time. A thread receives; the loop sends, and never waits.

    Args:
        description: of the robot.
        settings: ports, order and size of frames.
        report: takes what people should know of clients.
        blocking: for lockstep, in which no stamp is to come from the wall clock.

    Attributes:
        arrival: set when an answer has arrived, or a client came or went.
        ports: on which it listens: for the beginning, and for frames.

    Raises:
        DescriptionError: the robot's positions do not fit into frames.
        PortInUseError, LinkError: it cannot listen.
    """

    def __init__(
        self,
        description: RobotDescription,
        settings: Hoap3TcpSettings,
        report: Callable[[str], None],
        *,
        blocking: bool = False,
    ) -> None:
        self._frames = Frames(description, settings.slots)
        self._settings, self._report, self._blocking = settings, report, blocking
        self._stamp = 0  # of the answer before
        self._room = FIFO + description.delay_ticks
        self._state = State.allocate(**description.state_lengths)
        self._setpoint = Setpoint(description.n)
        self._setpoint.solver_status = NO_CERTIFICATE
        self._counts = {"clients": 0, "refused": 0, "overruns": 0, "unasked": 0, "not_finite": 0}
        self._arrived: deque[Arrival] = deque(maxlen=BACKLOG)
        self._requests: deque[Request] = deque()
        self._client: ClientConnection | None = None
        self._local: LocalControl | None = None
        self._closing = False
        self.arrival = threading.Event()
        self._beginnings = _listen(settings.host, settings.init_port)
        try:
            self._followers = _listen(settings.host, settings.control_port)
        except LinkError:
            self._beginnings.close()
            raise
        self.ports = (self._beginnings.getsockname()[1], self._followers.getsockname()[1])
        self._thread = threading.Thread(target=self._serve, name="receive", daemon=True)
        self._thread.start()

    def publish(self, state: bytes) -> None:
        """Send the positions of a State that asks for an answer; again is not sent again."""
        client = self._client
        if client is None:
            return
        self._state.load(state)
        mode, tick = self._state.mode, self._state.tick
        if mode != State.ACTIVE:
            if client.newest_tick >= 0:  # the robot does not follow it any more
                client.left = True
                client.leave()
            return
        if tick <= client.newest_tick or not client.wants_state(self._settings.order):
            return
        if len(client.flying) >= self._room:
            client.newest_tick = tick
            self._counts["overruns"] += 1
            return
        asked = (self._state.session_id, tick, self._state.epoch, self._state.stamp_published)
        client.send(self._frames.pack(self._state.q), asked)

    def drain(self) -> Sequence[Arrival]:
        """Answers that have arrived, as Setpoints without certificate."""
        arrived = self._arrived
        return [arrived.popleft() for _ in range(len(arrived))]

    def requests(self) -> Iterable[Request]:
        """Requests of this machine, and clients that came or went."""
        if self._local is not None:
            yield from self._local.requests()
        while self._requests:
            yield self._requests.popleft()

    def announce(self, event: bytes) -> None:
        """Nothing: the protocol has no events."""

    def tokens(self) -> Sequence[tuple[str, bool]]:
        """None: the protocol has no tokens."""
        return ()

    def look_again(self, who: str) -> None:
        """Say that a client has gone, unless it is connected."""
        client = self._client
        if client is None or client.who != who:
            self._ask("gone", who)

    def serve_also(self, local: LocalControl) -> None:
        """Take requests of the robot's own machine, too; they come first."""
        self._local = local

    def counts(self) -> dict[str, int]:
        """Clients that were served and refused, States not sent, and frames of no use."""
        return dict(self._counts)

    def close(self) -> None:
        """Leave the client, and the network."""
        self._closing = True
        self._thread.join(timeout=2.0)
        for listener in (self._beginnings, self._followers):
            listener.close()

    def _ask(self, verb: str, who: str, answer: Callable[[Any], None] = lambda _: None) -> None:
        self._requests.append(Request(verb, who, answer))
        self.arrival.set()

    def _serve(self) -> None:
        while not self._closing:
            connection = self._accept(self._beginnings, self._followers)
            if connection is None:
                continue
            with connection:
                client = self._begin(connection)
            if client is not None:
                with client.connection:
                    self._follow(client)

    def _begin(self, beginning: socket.socket) -> ClientConnection | None:
        """Read how many exchanges somebody wants, and wait for the connection that has them."""
        try:
            wanted = exchanges(self._first_bytes(beginning))
        except (OSError, WireError) as error:
            self._refuse(str(error))
            return None
        until = time.monotonic() + CONNECT_S
        while not self._closing and time.monotonic() < until:
            connection = self._accept(self._followers, self._beginnings)
            if connection is not None and _is_open(connection):
                self._counts["clients"] += 1
                who = f"hoap3_tcp-{self._counts['clients']}"
                return ClientConnection(who, connection, wanted)
        if not self._closing:
            self._refuse(f"did not connect to port {self.ports[1]} within {CONNECT_S:g} s")
        return None

    def _first_bytes(self, beginning: socket.socket) -> bytes:
        """What a client sends first; others wait until it has.

        Raises:
            OSError: it has gone, or is too slow; or we end.
        """
        data, until = b"", time.monotonic() + PATIENCE_S
        while len(data) < BEGINNING.size:
            if self._closing or time.monotonic() > until:
                raise TimeoutError(f"sent {len(data)} of 16 bytes within {PATIENCE_S:g} s")
            if select.select((beginning,), (), (), LOOK_MS / 1e3)[0]:
                more = beginning.recv(BEGINNING.size - len(data))
                if not more:
                    raise ConnectionError(f"has gone after {len(data)} of 16 bytes")
                data += more
        return data

    def _follow(self, client: ClientConnection) -> None:
        """Receive a client's frames until it goes, or has exchanged what it wanted."""

        def granted(answer: dict[str, Any] | bytes) -> None:
            if not (isinstance(answer, dict) and answer.get("granted")):
                client.left = True
                client.leave()

        poll = select.poll()
        for each in (client.connection, self._beginnings, self._followers):
            poll.register(each, select.POLLIN)
        self._client, end = client, "gone"
        self._ask("acquire", client.who, granted)
        try:
            while not (self._closing or client.complete):
                frame = self._receive(client, poll.poll)
                if frame is not None:
                    self._take(client, frame)
            end = "release"
        except OSError as error:
            if client.left:
                end = "release"
            else:
                self._report(f"client {client.who} {error}")
        finally:
            self._ask(end, client.who)
            self._client = None

    def _receive(
        self, client: ClientConnection, poll: Callable[[int], list[tuple[int, int]]]
    ) -> bytes | None:
        """The next whole frame; None where there is none yet. Further clients are sent away."""
        ready = [number for number, _ in poll(LOOK_MS)]
        # first, for where it has gone, who comes now is not a second one
        here = client.connection.fileno() in ready
        frame = client.receive(self._frames.size) if here else None
        for listener in (self._beginnings, self._followers):
            if listener.fileno() in ready:
                self._send_away(listener)
        return frame

    def _take(self, client: ClientConnection, frame: bytes) -> None:
        stamp, positions = time.monotonic_ns(), self._frames.unpack(frame)
        opens = client.received == 0 and self._settings.order == "legacy"
        client.received += 1
        asked = client.flying.popleft() if client.flying else None
        if asked is None:
            self._counts["unasked"] += not opens
        elif positions is None:
            self._counts["not_finite"] += 1
        else:
            answer = self._setpoint
            answer.session_id, answer.tick, answer.epoch, answer.stamp_state = asked
            self._set_stamps(stamp)
            answer.values[:] = positions
            self._arrived.append((stamp, answer.dump()))
        self.arrival.set()

    def _set_stamps(self, arrival: int) -> None:
        """The client's stamps do not travel: all it did counts as done when its frame arrives."""
        answer = self._setpoint
        now = answer.stamp_state if self._blocking else arrival
        answer.stamp_received = answer.stamp_decoded = answer.stamp_kinematics = now
        answer.stamp_solved = answer.stamp_encoded = now
        answer.stamp_sent_previous, self._stamp = self._stamp, now

    def _accept(self, listener: socket.socket, other: socket.socket) -> socket.socket | None:
        """Who connects to one port; who connects to the other one meanwhile is sent away."""
        readable, _, _ = select.select((listener, other), (), (), LOOK_MS / 1e3)
        if listener not in readable:
            if readable:
                self._send_away(other)
            return None
        try:
            connection, _ = listener.accept()
            set_up(connection)
        except OSError:  # it has gone again
            return None
        return connection

    def _send_away(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):
            listener.accept()[0].close()
            self._counts["refused"] += 1

    def _refuse(self, why: str) -> None:
        self._counts["refused"] += 1
        self._report(f"a client was refused: {why}")


def _is_open(connection: socket.socket) -> bool:
    """Whether who connected, maybe long ago, is still there."""
    try:
        return connection.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) != b""
    except BlockingIOError:
        return True
    except OSError:
        return False


def _listen(host: str, port: int) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen()
        listener.setblocking(False)  # who was waiting may be gone when it is accepted
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            raise PortInUseError(
                f"{host}:{port} is in use: another robot runs there. Stop it, or set "
                "link.hoap3_tcp to free ports"
            ) from error
        raise LinkError(
            f"cannot listen at {host}:{port}: {error.strerror or error}. Set link.hoap3_tcp.host "
            "to an address of this machine"
        ) from error
    return listener
