"""Links over Zenoh.

A State and its Setpoint travel as samples with the highest priority, unbatched. Whatever is
rare (description, authority, stop, recover) is a query, answered by the robot between two ticks.
"""

from __future__ import annotations

import contextlib
import json
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from queue import SimpleQueue
from typing import Any

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.base import Arrival, Request
from hoap3.protocol.link.local_control import LocalControl
from hoap3.protocol.link.name_claim import NameClaim
from hoap3.protocol.link.robot_sessions import RobotSession, name_conflict
from hoap3.protocol.link.zenoh_clients import (
    WAITING_STOPS,
    Clients,
    Queries,
    client_of,
    identity,
    leaf,
)
from hoap3.protocol.link.zenoh_guard import Guard
from hoap3.protocol.link.zenoh_session import (
    QUERY_TIMEOUT_S,
    ask,
    event_publisher,
    fast_publisher,
    key,
    open_session,
    robot_sessions,
    sampled_key,
    state_key,
    zenoh,
)
from hoap3.protocol.messages import WIRE_VERSION

BACKLOG = 1024  # setpoints; of more the oldest are dropped
WAITING_ANSWERS = 256  # with as many no further such request is taken: somebody takes none
CONTROL = frozenset({"about", "acquire", "change", "release", "show", "tasks"})
"""What a controller can be asked."""
OTHERS = 2  # setpoints of clients without authority that are taken between two ticks
REFUSED_AT_ONCE = 4  # requests of those without the right; then stops alone, as many as wait
LONGEST_VERB = 64  # characters; more are cut off
PENDING = 16  # requests to a controller; of more the oldest get no answer
FRESH_S = 0.75 * QUERY_TIMEOUT_S  # of a request to a controller: who asked still waits
TARGETS = 64  # that wait for a controller; of more the oldest are lost
EVENTS = 16  # of the robot that a controller keeps; of more the oldest are lost


class ZenohRobotLink:
    """The robot's side.

    One thread of Python's blocks in `recv` and stamps what arrives; everything else happens in
    the loop, which polls. A query or a vanished client costs the loop nothing until it comes.
    Answers are sent by threads of their own, those to `stop` by another one than the rest: who
    asks and then freezes, holds up that one alone.

    Args:
        robot: name of the robot.
        settings: how it is reached.
        blocking: wait for the network rather than drop a State; for lockstep only.
        report: takes other robots with the same name.
        session_id: of the robot.

    Attributes:
        arrival: set when a Setpoint has arrived, for those who wait.

    Raises:
        NameTakenError: a robot of that name is alive on this network.
    """

    def __init__(
        self,
        robot: str,
        settings: LinkSettings,
        *,
        blocking: bool = False,
        report: Callable[[str], None] = lambda _: None,
        session_id: int = 0,
    ) -> None:
        self._overflowed = 0
        self.arrival, self._blocking = threading.Event(), blocking
        self._give_way = _way_to_sender()
        self._local: LocalControl | None = None
        self._sampling = Sampling()
        self._to_show: deque[bytes] = deque(maxlen=1)
        self._session = session = open_session(settings, robot, loops=True)
        self._guard = Guard(session, settings.secure, report) if settings.secure else None
        try:
            self._name = NameClaim(session, robot, settings, session_id, report)
            self._state = fast_publisher(session, state_key(robot), blocking)
            self._sampled = session.declare_publisher(
                sampled_key(robot, f"state/{WIRE_VERSION}"), express=True
            )
            self._events = event_publisher(session, key(robot, "events"))
            self._queries = Queries(session, robot)
            self._clients = Clients(session, robot)
            self._setpoints = session.declare_subscriber(
                key(robot, "setpoint/**"), zenoh.handlers.RingChannel(BACKLOG)
            )
            self._token = session.liveliness().declare_token(key(robot, "alive"))
        except BaseException:
            if hasattr(self, "_name"):
                self._name.close()
            session.close()
            raise
        self._arrived: deque[Arrival] = deque(maxlen=BACKLOG)
        self._others = 0  # of them that are not the holder's, since the last look
        self._holder = ""  # how the key of its setpoints ends, cut as names are
        self._crowded_out = 0
        self._query: zenoh.Query | None = None  # taken, and not served yet
        self._asking = key(robot, "ask")
        self._clients.start()
        if self._guard is not None:
            self._guard.start()
        self._answers, self._stop_answers = _Answers(), _Answers()
        self._receiver = threading.Thread(target=self._receive, name="receive", daemon=True)
        self._receiver.start()

    @property
    def name_conflicts(self) -> int:
        """How many other robots on the network use the robot's name."""
        return self._name.conflicts

    def publish(self, state: bytes) -> None:
        """Send a State.

        Those who only look on get theirs while the robot has nothing to do: once its answer has
        come, or with the next where none did.
        """
        if self._name.conflicts and self._name.is_quiet(state):
            return
        self._state.put(state)
        self._show()
        if self._sampling.takes(state):
            self._to_show.append(state)
            if self._blocking:
                self._show()
        self._give_way()

    def announce(self, event: bytes) -> None:
        """Send an Event."""
        self._events.put(event)

    def drain(self) -> Sequence[Arrival]:
        """Setpoints that have arrived, with the stamp of the receive thread.

        All of the client that was granted authority last, and up to `OTHERS` of anybody else: a
        flood costs the loop and the log no more than that.
        """
        arrived, self._others = self._arrived, 0
        return [arrived.popleft() for _ in range(len(arrived))]

    def requests(self) -> Iterable[Request]:
        """Requests of this machine, then queries, and clients that vanished before each.

        The tokens are looked at after a query was taken, and before it is served: so a client's
        token is known if it was declared before the query was sent, and also if it has gone since.
        """
        if self._local is not None:
            yield from self._local.requests()
        refused = 0
        while refused < WAITING_STOPS:
            if self._query is None:
                self._query = self._queries.try_recv(
                    stops=not self._stop_answers.full(),
                    others=refused < REFUSED_AT_ONCE and not self._answers.full(),
                )
            for who in self._clients.vanished():
                yield Request("gone", who, lambda _: None)
            if self._query is None:
                return
            query, self._query = self._query, None
            answers = self._stop_answers if self._queries.is_stop(query) else self._answers
            request = answers.request(query, self._asking)
            if self._guard is not None:
                admitted = self._guard.admitted(request)
                if admitted is None:
                    refused += 1
                    continue
                request = admitted
            if request.verb == "acquire":
                present = self._clients.asks(request.who)
                request = replace(request, present=present, answer=self._noting(request))
            yield request

    def tokens(self) -> Sequence[tuple[str, bool]]:
        """Clients whose tokens have come (True) or gone since the last call."""
        return self._clients.changes()

    def look_again(self, who: str) -> None:
        """Check whether a client is alive, in a thread."""
        self._clients.look_again(who)

    def serve_also(self, local: LocalControl) -> None:
        """Take requests of the robot's own machine, too; they come first."""
        self._local = local

    def counts(self) -> dict[str, int]:
        """Setpoints of others that it had no room for; with certificates, what was not let in.

        `overflowed`, where it is above 0: setpoints dropped as the loop did not take them in time.
        What is lost on the way shows in the robot's own counts.
        """
        refused = {} if self._guard is None else self._guard.counts()
        overflowed = {"overflowed": self._overflowed} if self._overflowed else {}
        return {"crowded_out": self._crowded_out, **overflowed, **refused}

    def close(self) -> None:
        """Leave the network, after the answers that are due; the threads end with it."""
        self._show()
        self._stop_answers.finish()
        self._answers.finish()
        self._clients.finish()
        if self._guard is not None:
            self._guard.close()
        self._name.close()
        self._session.close()
        self._stop_answers.join()
        self._answers.join()
        self._clients.join()
        self._receiver.join(timeout=2.0)

    def _receive(self) -> None:
        receive, arrived, now = self._setpoints.recv, self._arrived.append, time.monotonic_ns
        signal = self.arrival.set if self._blocking else _nothing
        follows = None if self._guard is None else self._guard.follows
        try:
            while True:
                sample = receive()
                if follows is not None and not follows(leaf(sample.key_expr)):
                    continue
                if client_of(sample.key_expr) != self._holder and not self._has_room():
                    continue
                self._overflowed += len(self._arrived) >= BACKLOG
                arrived((now(), sample.payload.to_bytes()))
                signal()
                self._show()
        except zenoh.ZError:
            return  # the session was closed

    def _has_room(self) -> bool:
        """Whether a setpoint of another than the holder is taken; each is asked about once."""
        if self._others >= OTHERS:
            self._crowded_out += 1
            return False
        self._others += 1
        return True

    def _noting(self, request: Request) -> Callable[[dict[str, Any] | bytes], None]:
        """Its answer, which first tells whose setpoints are all taken."""

        def answer(content: dict[str, Any] | bytes) -> None:
            if isinstance(content, dict) and content.get("granted"):
                self._holder = request.who
            request.answer(content)

        return answer

    def _show(self) -> None:
        """Send what waits to be seen; from either thread, once."""
        if self._to_show:
            with contextlib.suppress(IndexError):  # the other thread has it
                self._sampled.put(self._to_show.popleft())


class ZenohControllerLink:
    """The controller's side: the newest State only, older ones are overwritten.

    Args:
        robot: name of the robot.
        settings: how to reach it.
        who: name under which authority is held; a liveliness token says that we are there.

    Attributes:
        presence: set while the robot is alive.
        departures: how often it went away; it may be back before anybody has looked.
        linked: whether there has been a connection to anybody. A session that has had none is as
            good as new.
        session_id: of the robot that is followed, -1 before.
    """

    def __init__(
        self, robot: str, settings: LinkSettings, who: str, *, blocking: bool = False
    ) -> None:
        self.robot, self.who, self.session_id = robot, who, -1
        self._robots: frozenset[RobotSession] = frozenset()
        self.presence, self.departures = threading.Event(), 0
        self._asked: deque[tuple[float, Request]] = deque(maxlen=PENDING)
        self.linked, self._waking, self._closed = False, threading.Lock(), False
        self._sampling = Sampling()
        self._give_way = _way_to_sender()
        self._session = session = open_session(settings, robot, loops=True)
        self._answers = _Answers()
        try:
            session.info.declare_link_events_listener(self._link_changed, history=True)
            self._setpoint = fast_publisher(session, key(robot, f"setpoint/{who}"), blocking)
            self._states = session.declare_subscriber(
                state_key(robot), zenoh.handlers.RingChannel(1)
            )
            self._waker = session.declare_publisher(
                state_key(robot), allowed_destination=zenoh.Locality.SESSION_LOCAL
            )
            self._sampled = session.declare_publisher(
                sampled_key(robot, f"setpoint/{who}"), express=True
            )
            self._events = session.declare_subscriber(
                key(robot, "events"), zenoh.handlers.RingChannel(EVENTS)
            )
            self._targets = session.declare_subscriber(
                key(robot, "targets/*"), zenoh.handlers.RingChannel(TARGETS)
            )
            self._queries = session.declare_queryable(key(robot, "control/**"), self._queried)
            self._token = session.liveliness().declare_token(key(robot, f"clients/{who}"))
            self._others = session.liveliness().declare_subscriber(
                key(robot, "clients/*"), zenoh.handlers.RingChannel(TARGETS)
            )
            self._sessions = session.liveliness().declare_subscriber(
                key(robot, "session/*"), self._session_changed, history=True
            )
            self._presence = session.liveliness().declare_subscriber(
                key(robot, "alive"), self._presence_changed, history=True
            )
        except BaseException:
            self._answers.finish()
            session.close()
            raise

    def wait(self) -> Arrival | None:
        """Block until a State is there; None when woken because the robot came or went."""
        payload = self._states.recv().payload.to_bytes()
        stamp = time.monotonic_ns()
        return (stamp, payload) if payload else None

    def publish(self, setpoint: bytes) -> None:
        """Send a Setpoint."""
        self._setpoint.put(setpoint)
        if self._sampling.takes(setpoint):
            self._sampled.put(setpoint)
        self._give_way()

    def wake(self) -> None:
        """Make `wait` return None; from any thread."""
        with self._waking:
            if not self._closed:  # else nobody waits
                self._waker.put(b"")

    def ask(self, verb: str, timeout_s: float = QUERY_TIMEOUT_S, body: bytes = b"") -> bytes | None:
        """Ask the robot; its answer, or None where it gives none in time."""
        return ask(self._session, self.robot, verb, self.who, body, timeout_s=timeout_s)

    def close(self) -> None:
        """Leave the network."""
        self._answers.finish()
        with self._waking:
            already, self._closed = self._closed, True
        if not already:
            for publisher in (self._setpoint, self._waker):
                publisher.undeclare()  # else Zenoh keeps some 10 kB of each for ever
        self._session.close()
        self._answers.join()

    def request(self) -> Request | None:
        """The oldest thing that was asked of the controller, unless who asked has given up."""
        while self._asked:
            asked_s, request = self._asked.popleft()
            if time.monotonic() < asked_s + FRESH_S:
                return request
        return None

    def event(self) -> bytes | None:
        """The oldest Event of the robot that is kept, if there is one."""
        sample = self._events.try_recv()
        return None if sample is None else sample.payload.to_bytes()

    def target(self) -> tuple[str, bytes] | None:
        """The oldest Target that is kept, behind the name of who sent it, if there is one."""
        sample = self._targets.try_recv()
        return None if sample is None else (leaf(str(sample.key_expr)), sample.payload.to_bytes())

    def vanished(self) -> str | None:
        """Name of a client whose token came or went, if it went; one for each call."""
        sample = self._others.try_recv()
        if sample is None or sample.kind != zenoh.SampleKind.DELETE:
            return None
        return client_of(sample.key_expr)

    def _queried(self, query: zenoh.Query) -> None:
        """In a thread of Zenoh's. Queued; served after the next State."""
        if self._answers.full():
            return  # who asked gets no answer
        request = self._answers.request(query, key(self.robot, "control"))
        if request.verb in CONTROL:
            self._asked.append((time.monotonic(), request))
        else:
            request.answer({"error": f"unknown request {request.verb!r}"})

    def _link_changed(self, event: zenoh.LinkEvent) -> None:
        self.linked |= event.kind == zenoh.SampleKind.PUT

    def name_conflict(self) -> str:
        """Which robots use the name, where there are several; else ""."""
        robots = [found for _, found in robot_sessions(self._session, self.robot)]
        return name_conflict(self.robot, robots) if len(robots) > 1 else ""

    def _session_changed(self, sample: zenoh.Sample) -> None:
        found = RobotSession.read(sample.key_expr)
        if found is None:
            return
        if sample.kind == zenoh.SampleKind.PUT:
            self._robots |= {found}
            return
        self._robots -= {found}
        if found.session_id == self.session_id or not self._robots:
            self._depart()

    def _presence_changed(self, sample: zenoh.Sample) -> None:
        """Where session tokens are seen, they say whether the robot is the one that has gone."""
        if sample.kind == zenoh.SampleKind.PUT:
            self.presence.set()
            self.wake()
        elif not self._robots:
            self._depart()

    def _depart(self) -> None:
        self.departures += 1
        self.presence.clear()
        self.wake()


class _Answers:
    """Sends answers by a thread of its own: who asks and then freezes holds up nobody else."""

    def __init__(self) -> None:
        self._due: SimpleQueue[tuple[zenoh.Query, bytes] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._send, name="answer", daemon=True)
        self._thread.start()

    def request(self, query: zenoh.Query, root: str) -> Request:
        """A query to `root/<verb>/<who>` as a request, whose answer is sent from here."""

        def answer(content: dict[str, Any] | bytes) -> None:
            payload = content if isinstance(content, bytes) else json.dumps(content).encode()
            self._due.put((query, payload))

        body = query.payload.to_bytes() if query.payload else b""
        text = str(query.key_expr)
        asked = text.removeprefix(f"{root}/")
        verb, _, who = (leaf(text) if asked == text else asked).partition("/")
        return Request(verb[:LONGEST_VERB], identity(who.encode()), answer, body)

    def full(self) -> bool:
        """Whether so many answers wait to be sent that no further request is to be taken."""
        return self._due.qsize() >= WAITING_ANSWERS

    def finish(self) -> None:
        """Send what is due, unless somebody froze; before the session is closed."""
        self._due.put(None)
        self._thread.join(timeout=0.5)

    def join(self) -> None:
        """Wait for the thread; after the session was closed."""
        self._thread.join(timeout=2.0)

    def _send(self) -> None:
        while (due := self._due.get()) is not None:
            with contextlib.suppress(zenoh.ZError):  # who asked may be gone
                _reply(*due)


def _reply(query: zenoh.Query, payload: bytes) -> None:
    with query:
        query.reply(query.key_expr, payload)


def _way_to_sender() -> Callable[[], None]:
    """What lets Zenoh's thread send at once.

    It has our CPU and, under SCHED_FIFO, our priority: it would wait until we sleep. Under any
    other policy giving way may cost a slice of time, and the thread need not wait.
    """
    return os.sched_yield if os.sched_getscheduler(0) == os.SCHED_FIFO else _nothing


def _nothing() -> None:
    """Nobody waits for an arrival in real time, nor for us to give way."""


SAMPLED_TICKS = 16  # 62.5 Hz of a robot at 1 kHz
_KIND, _TICK = slice(8, 12), slice(20, 28)
"""Mode of a State or command of a Setpoint, and the tick; see docs/reference/wire.md."""


class Sampling:
    """Of each `SAMPLED_TICKS` ticks the first message, and each where the mode changed."""

    def __init__(self) -> None:
        self._last = (b"", -1)

    def takes(self, message: bytes) -> bool:
        """Whether a State or a Setpoint is one of them; each message is asked about once."""
        this = message[_KIND], int.from_bytes(message[_TICK], "little") // SAMPLED_TICKS
        if this == self._last:
            return False
        self._last = this
        return True
