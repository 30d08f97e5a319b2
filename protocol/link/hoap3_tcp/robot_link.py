"""The robot's side of HOAP-3's own TCP protocol, in place of Zenoh.

A client that has connected is the holder of authority. While the robot follows it, each State is
sent as a frame of encoder counts, and the client's frames answer them in the order in which they
were sent: nothing else says which belongs to which.
"""

from __future__ import annotations

import select
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from hoap3.protocol.config.settings import Hoap3TcpSettings
from hoap3.protocol.link.base import Arrival, Request, RobotLink
from hoap3.protocol.link.hoap3_tcp.client_connection import SAME, ClientConnection
from hoap3.protocol.link.hoap3_tcp.frames import Frames
from hoap3.protocol.link.hoap3_tcp.reception import LOOK_S, Hoap3Reception
from hoap3.protocol.link.local_control import LocalControl
from hoap3.protocol.messages import Setpoint, State, schema
from hoap3.protocol.robot.description import RobotDescription

FIFO = 8  # States that wait for their answers; further ones are not sent: an overrun
PAUSE_S = 0.001  # until the loop has heard of the last client
MOST_REPORTS, REPORTS_S = 10, 10.0  # so many in that time at most: clients may come and go

NO_CERTIFICATE = schema("Setpoint").constants["STATUS_NONE"]


class Hoap3RobotLink(RobotLink):
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

    name_conflicts = 0

    def __init__(
        self,
        description: RobotDescription,
        settings: Hoap3TcpSettings,
        report: Callable[[str], None],
        *,
        blocking: bool = False,
    ) -> None:
        self._frames = Frames(description, settings.slots)
        self._report, self._blocking = report, blocking
        self._legacy = settings.order == "legacy"
        self._stamp = 0  # of the answer before
        self._room = FIFO + description.delay_ticks
        self._state = State.allocate(**description.state_lengths)
        self._setpoint = Setpoint(description.n)
        self._setpoint.solver_status = NO_CERTIFICATE
        self._counts = {"clients": 0, "overruns": 0, "unasked": 0, "not_finite": 0}
        self._arrived: deque[Arrival] = deque()  # no more than were in flight
        self._reported: deque[float] = deque(maxlen=MOST_REPORTS)
        self._requests: deque[Request] = deque()
        self._client: ClientConnection | None = None
        self._local: LocalControl | None = None
        self._closing = False
        self.arrival = threading.Event()
        self._reception = Hoap3Reception(settings, lambda: self._closing, self._say)
        self.ports = self._reception.ports
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
        if tick <= client.newest_tick or not client.wants_state:
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
        return {**self._counts, "refused": self._reception.refused}

    def close(self) -> None:
        """Leave the client, and the network."""
        self._closing = True
        self._thread.join(timeout=2.0)
        self._reception.close()

    def _ask(self, verb: str, who: str, answer: Callable[[Any], None] = lambda _: None) -> None:
        self._requests.append(Request(verb, who, answer))
        self.arrival.set()

    def _say(self, text: str) -> None:
        now, said = time.monotonic(), self._reported
        if len(said) < MOST_REPORTS or now - said[0] > REPORTS_S:
            said.append(now)
            self._report(text)

    def _serve(self) -> None:
        while not self._closing:
            if self._requests:
                time.sleep(PAUSE_S)
                continue
            found = self._reception.next_client()
            if found is not None:
                connection, wanted = found
                with connection:
                    self._counts["clients"] += 1
                    who, legacy = f"hoap3_tcp-{self._counts['clients']}", self._legacy
                    size = self._frames.size
                    self._follow(ClientConnection(who, connection, wanted, size, legacy=legacy))

    def _follow(self, client: ClientConnection) -> None:
        """Receive a client's frames until it goes, or has exchanged what it wanted."""

        def granted(answer: dict[str, Any] | bytes) -> None:
            if not (isinstance(answer, dict) and answer.get("granted")):
                client.left = True
                client.leave()

        poll = select.poll()
        for each in (client.connection, *self._reception.listeners):
            poll.register(each, select.POLLIN)
        self._client, end = client, "release"
        self._ask("acquire", client.who, granted)
        try:
            while not (self._closing or client.complete):
                frame = self._receive(client, poll)
                if frame is not None:
                    self._take(client, frame)
        except ConnectionError as error:
            in_order = client.left or client.served
            end = "release" if in_order else "gone"
            if not in_order or client.within_frame:
                self._say(f"client {client.who} {error}")
        finally:
            self._ask(end, client.who)
            self._client = None

    def _receive(self, client: ClientConnection, poll: select.poll) -> bytes | None:
        """The next whole frame; None where there is none yet. Further clients are sent away."""
        ready = [number for number, _ in poll.poll(LOOK_S * 1e3)]
        # first, for where it has gone, who comes now is not a second one
        frame = client.receive() if client.connection.fileno() in ready else None
        for listener in self._reception.listeners:
            if listener.fileno() in ready:
                self._reception.send_away(listener)
        doubt = client.doubt() if frame is None else ""
        if doubt:
            self._say(f"client {client.who} {doubt}")
        return frame

    def _take(self, client: ClientConnection, frame: bytes) -> None:
        stamp, positions = time.monotonic_ns(), self._frames.unpack(frame)
        opens = client.received == 0 and self._legacy
        client.received += 1
        asked = client.flying.popleft() if client.flying else None
        if asked is None:
            self._counts["unasked"] += not opens
            if not opens and client.newest_tick < 0:
                self._say(f"client {client.who} speaks first: {SAME}.order?")
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
