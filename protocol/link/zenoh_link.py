"""Links over Zenoh. Nothing else in the project imports zenoh.

A State and its Setpoint travel as samples with the highest priority, unbatched. Whatever is
rare (description, authority, stop, recover) is a query, answered by the robot between two ticks.

Peers of version 1 of the wire are spoken to in version 1, and their messages become ones of today
here, so that nothing else knows of them. They use keys without the sender's name at their end.
"""

from __future__ import annotations

import contextlib
import json
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from queue import SimpleQueue
from typing import Any, Literal

os.environ.setdefault(
    # Read once, at import. Few threads cost least, but receiving may wait until something is sent,
    # and closing many connections that never say a word would delay the data.
    "ZENOH_RUNTIME",
    "(rx:(handover:app),tx:(worker_threads:1),acc:(worker_threads:1),net:(handover:app),"
    "app:(worker_threads:1))",
)

import zenoh

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.errors import LinkError, NameTakenError, PortInUseError
from hoap3.protocol.link.base import Arrival, Request
from hoap3.protocol.link.local_control import LocalControl
from hoap3.protocol.link.session_limits import MAX_MESSAGE_BYTES, SIZE_FILTER, accept_limits
from hoap3.protocol.link.zenoh_sockets import forbid_lingering
from hoap3.protocol.messages import WIRE_VERSION, Setpoint, State
from hoap3.protocol.wire_versions import OLDEST, downgraded, upgraded

BACKLOG = 1024  # setpoints; of more the oldest are dropped
WAITING_STOPS = 16  # queries; of more the oldest are dropped, which ends them without an answer
WAITING_QUERIES = 64
WAITING_ANSWERS = 256  # with as many no further request is taken: somebody takes none
CONTROL = frozenset({"change", "show"})  # what a controller can be asked
PENDING = 16  # requests to a controller; of more the oldest get no answer
QUERY_TIMEOUT_S = 2.0
FRESH_S = 0.75 * QUERY_TIMEOUT_S  # of a request to a controller: who asked still waits
MAX_CLIENTS = 1024  # whose tokens a robot remembers; the oldest are forgotten first
TOKENS = 256  # that came or went and wait for the loop; of more the oldest are lost
TOKENS_AT_ONCE = 8  # that are taken before each request
EVENTS = 16  # of the robot that a controller keeps; of more the oldest are lost
LOOKS = 8  # clients whose tokens are looked up together
LOOK_PAUSE_S = 0.05  # before each look-up: requests may come by the thousand
CLOSE_US = 1_000_000  # a peer that takes no answer for so long is disconnected
DROP_US = 100
"""How long a State waits for room on its way to a peer that takes nothing: at each tick."""


def key(robot: str, leaf: str) -> str:
    """Key expression of one of a robot's resources."""
    return f"robots/{robot}/{leaf}"


def state_key(robot: str, version: int = WIRE_VERSION) -> str:
    """Where a robot publishes its States in a version of the wire."""
    return key(robot, "state" if version == OLDEST else f"state/{version}")


def open_session(settings: LinkSettings) -> zenoh.Session:
    """A session that listens, connects and discovers exactly what the settings say.

    Raises:
        PortInUseError: somebody listens on one of the endpoints.
        LinkError: an endpoint that Zenoh cannot use.
    """
    congestion = {
        "drop": {"wait_before_drop": DROP_US},
        "block": {"wait_before_close": CLOSE_US},
    }
    config = {
        "mode": settings.mode,
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "listen": {"endpoints": list(settings.listen)},
        "connect": {
            "endpoints": list(settings.connect),
            "timeout_ms": -1 if settings.mode == "peer" else 3000,
            "exit_on_failure": settings.mode == "client",
            "retry": {"period_init_ms": 100, "period_max_ms": 200, "period_increase_factor": 1.5},
        },
        "transport": {
            "shared_memory": {"enabled": False},
            "unicast": accept_limits(),
            "link": {
                "tx": {"lease": settings.lease_ms, "queue": {"congestion_control": congestion}},
                "rx": {"max_message_size": MAX_MESSAGE_BYTES},
            },
        },
        "low_pass_filter": [SIZE_FILTER],
    }
    try:
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    except zenoh.ZError as error:
        text = str(error)
        endpoints = ", ".join(settings.listen or settings.connect)
        if "in use" in text:
            raise PortInUseError(
                f"{endpoints} is in use: another robot runs there. Stop it, or set link.listen "
                "to a free port"
            ) from error
        if settings.mode == "client":
            raise LinkError(
                f"nobody answers at {endpoints}: is the robot running, and is this its endpoint?"
            ) from error
        reason = text.partition(" at /")[0]  # without the place in Zenoh's source
        raise LinkError(f"cannot open {endpoints}: {reason}") from error
    session.info.declare_link_events_listener(_link_changed, history=True)
    return session


class ZenohRobotLink:
    """The robot's side.

    One thread of Python's blocks in `recv` and stamps what arrives; everything else happens in
    the loop, which polls. A query or a vanished client costs the loop nothing until it comes.
    Answers are sent by a thread of their own: who asks and then freezes, holds up that one alone.

    Args:
        robot: name of the robot.
        settings: how it is reached.
        blocking: wait for the network rather than drop a State; for lockstep only.
        report: is told of the first peer of version 1, in a thread.

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
    ) -> None:
        self.arrival, self._blocking = threading.Event(), blocking
        self._report, self._old_listens, self._told = report, False, False
        self._give_way = _way_to_sender()
        self._local: LocalControl | None = None
        self._session = session = open_session(settings)
        try:
            if _alive(session, robot):
                raise NameTakenError(
                    f"a robot called {robot!r} is alive already; stop it, or give this one "
                    "another name"
                )
            self._state = _fast_publisher(session, state_key(robot), blocking)
            self._old_state = _fast_publisher(session, state_key(robot, OLDEST), blocking)
            self._old_state.declare_matching_listener(self._old_listens_now)
            self._events = session.declare_publisher(key(robot, "events"), express=True)
            self._queries = _Queries(session, robot)
            self._clients = _Clients(session, robot)
            self._setpoints = session.declare_subscriber(
                key(robot, "setpoint/**"), zenoh.handlers.RingChannel(BACKLOG)
            )
            self._token = session.liveliness().declare_token(key(robot, "alive"))
        except BaseException:
            session.close()
            raise
        self._arrived: deque[Arrival] = deque(maxlen=BACKLOG)
        self._query: zenoh.Query | None = None  # taken, and not served yet
        self._clients.start()
        self._answers = _Answers()
        self._receiver = threading.Thread(target=self._receive, name="receive", daemon=True)
        self._receiver.start()

    def publish(self, state: bytes) -> None:
        """Send a State."""
        self._state.put(state)
        if self._old_listens:
            self._old_state.put(downgraded(State, state))
        self._give_way()

    def announce(self, event: bytes) -> None:
        """Send an Event."""
        self._events.put(event)

    def drain(self) -> Sequence[Arrival]:
        """Setpoints that have arrived, with the stamp of the receive thread."""
        arrived = self._arrived
        return [arrived.popleft() for _ in range(len(arrived))]

    def requests(self) -> Iterable[Request]:
        """Requests of this machine, then queries, and clients that vanished before each.

        The tokens are looked at after a query was taken, and before it is served: so a client's
        token is known if it was declared before the query was sent, and also if it has gone since.
        """
        if self._local is not None:
            yield from self._local.requests()
        while True:
            if self._query is None:
                self._query = None if self._answers.full() else self._queries.try_recv()
            for who in self._clients.vanished():
                yield Request("gone", who, lambda _: None)
            if self._query is None:
                return
            query, self._query = self._query, None
            request = self._answers.request(query, "ask")
            if request.verb == "acquire":
                request = replace(request, present=self._clients.asks(request.who))
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
        """Nothing: what is lost on the way shows in the robot's own counts."""
        return {}

    def close(self) -> None:
        """Leave the network, after the answers that are due; the threads end with it."""
        self._answers.finish()
        self._clients.finish()
        self._session.close()
        self._answers.join()
        self._clients.join()
        self._receiver.join(timeout=2.0)

    def _receive(self) -> None:
        receive, arrived, now = self._setpoints.recv, self._arrived.append, time.monotonic_ns
        signal = self.arrival.set if self._blocking else _nothing
        try:
            while True:
                sample = receive()
                arrived((now(), upgraded(Setpoint, sample.payload.to_bytes())))
                signal()
        except zenoh.ZError:
            return  # the session was closed

    def _old_listens_now(self, status: zenoh.MatchingStatus) -> None:
        """In a thread of Zenoh's, where the first comes or the last goes."""
        self._old_listens = status.matching
        if status.matching and not self._told:
            self._told = True
            self._report(
                f"a client speaks wire version {OLDEST}: it gets no rates of the reference and "
                "tells nothing of what it decided"
            )


class _Queries:
    """Queries to the robot, `stop` first. A full queue drops its oldest, whose client learns that.

    Zenoh's thread never waits for room here: it also carries what the holder sends.
    """

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        ring, self._stop = zenoh.handlers.RingChannel, key(robot, "ask/stop")
        self._stops = session.declare_queryable(f"{self._stop}/**", ring(WAITING_STOPS))
        self._others = session.declare_queryable(key(robot, "ask/**"), ring(WAITING_QUERIES))

    def try_recv(self) -> zenoh.Query | None:
        """The next query, if there is one; both queues get each `stop`, the first one counts."""
        for queue, stops in ((self._stops, True), (self._others, False)):
            while (query := queue.try_recv()) is not None:
                if _of(query.key_expr, self._stop) == stops:
                    return query
        return None


class _Clients:
    """The clients whose liveliness tokens are seen.

    Tokens come and go as samples, which the robot's loop takes. A single client is looked up by a
    thread, because that may block. All other methods belong to the loop, and never block. Under a
    flood samples are lost rather than that they hold up setpoints; a look-up makes up for that.

    Args:
        session, robot: whose clients.
    """

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        self._liveliness, self._robot = session.liveliness(), robot
        self._samples = self._liveliness.declare_subscriber(
            key(robot, "clients/*"), zenoh.handlers.RingChannel(TOKENS), history=True
        )
        self._seen: dict[str, int] = {}  # after how many samples; the oldest first
        self._asked: dict[str, int] = {}  # for authority, likewise
        self._changes = deque[tuple[str, bool]](maxlen=TOKENS)
        self._taken = self._deleted = 0  # samples, and that of the last token that went
        self._wanted: SimpleQueue[str | None] = SimpleQueue()
        self._found: SimpleQueue[tuple[str, bool, int]] = SimpleQueue()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._look, name="clients", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def asks(self, who: str) -> bool:
        """Note that a client asks for authority; whether its token is seen."""
        _remember(self._asked, who, self._taken)
        return who in self._seen

    def changes(self) -> Sequence[tuple[str, bool]]:
        """Clients whose tokens have come (True) or gone since the last call."""
        if not self._changes:
            return ()
        changes = tuple(self._changes)
        self._changes.clear()
        return changes

    def vanished(self) -> Iterator[str]:
        """Clients that asked for authority and whose tokens have gone.

        Each is to be served before the next is taken.
        """
        for _ in range(TOKENS_AT_ONCE):
            sample = self._samples.try_recv()
            if sample is None:
                break
            self._taken += 1
            who, came = _client(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
            self._changes.append((who, came))
            if came:
                _remember(self._seen, who, self._taken)
            else:
                self._deleted = self._taken
                self._seen.pop(who, None)
                if self._asked.pop(who, None) is not None:
                    yield who
        while not self._found.empty():
            who, alive, taken = self._found.get()
            if alive and self._deleted <= taken:
                _remember(self._seen, who, self._taken)
            elif not alive and self._seen.get(who, 0) <= taken:
                self._seen.pop(who, None)
                yield who

    def look_again(self, who: str) -> None:
        """Have the thread look up a client; where many wait for that, it is not done."""
        if self._wanted.qsize() < LOOKS:
            self._wanted.put(who)

    def finish(self) -> None:
        """Look up nothing more; before the session is closed."""
        self._closing.set()
        self._wanted.put(None)

    def join(self) -> None:
        """Wait for the thread; after the session was closed."""
        self._thread.join(timeout=2.0)

    def _look(self) -> None:
        while not self._closing.is_set():
            wanted = {self._wanted.get()}
            if self._closing.wait(LOOK_PAUSE_S):
                return
            wanted.update(self._wanted.get() for _ in range(self._wanted.qsize()))
            for who in wanted - {None}:
                with contextlib.suppress(zenoh.ZError):  # a name that no key can have, or closing
                    self._look_up(str(who))

    def _look_up(self, who: str) -> None:
        taken = self._taken  # what comes or goes after this is newer than what is found
        token = key(self._robot, f"clients/{who}")
        replies = list(self._liveliness.get(token, timeout=QUERY_TIMEOUT_S))
        if all(reply.ok for reply in replies):  # else it took too long
            names = {_client(reply.ok.key_expr) for reply in replies if reply.ok}
            self._found.put((who, who in names, taken))  # a wildcard finds others


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
        wire_version: that the robot speaks, as far as its answers tell.
    """

    def __init__(
        self, robot: str, settings: LinkSettings, who: str, *, blocking: bool = False
    ) -> None:
        self.robot, self.who = robot, who
        self.presence, self.departures = threading.Event(), 0
        self._asked: deque[tuple[float, Request]] = deque(maxlen=PENDING)
        self.linked, self.wire_version = False, WIRE_VERSION
        self._waking, self._closed, self._blocking = threading.Lock(), False, blocking
        self._declared: list[Any] = []  # what is for one version of the wire
        self._give_way = _way_to_sender()
        self._session = session = open_session(settings)
        self._answers = _Answers()
        try:
            session.info.declare_link_events_listener(self._link_changed, history=True)
            self._speak(WIRE_VERSION)
            self._events = session.declare_subscriber(
                key(robot, "events"), zenoh.handlers.RingChannel(EVENTS)
            )
            self._queries = session.declare_queryable(key(robot, "control/**"), self._queried)
            self._token = session.liveliness().declare_token(key(robot, f"clients/{who}"))
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
        return (stamp, upgraded(State, payload)) if payload else None

    def publish(self, setpoint: bytes) -> None:
        """Send a Setpoint."""
        if self.wire_version == OLDEST:
            setpoint = downgraded(Setpoint, setpoint)
        self._setpoint.put(setpoint)
        self._give_way()

    def wake(self) -> None:
        """Make `wait` return None; from any thread."""
        with self._waking:
            if not self._closed:  # else nobody waits
                self._waker.put(b"")

    def ask(self, verb: str, timeout_s: float = QUERY_TIMEOUT_S, body: bytes = b"") -> bytes | None:
        """Ask the robot; its answer, or None where it gives none in time.

        Where it speaks another version of the wire than before, that is spoken from now on.
        """
        version, answer = ask_versions(self._session, self.robot, verb, self.who, body, timeout_s)
        if answer is not None and version != self.wire_version:
            self._speak(version)
        return answer

    def _speak(self, version: int) -> None:
        """Listen to States, and send Setpoints, of a version of the wire."""
        session, state = self._session, state_key(self.robot, version)
        setpoint = key(self.robot, "setpoint" if version == OLDEST else f"setpoint/{self.who}")
        with self._waking:
            for declared in self._declared:
                declared.undeclare()
            self.wire_version = version
            self._setpoint = _fast_publisher(session, setpoint, self._blocking)
            self._states = session.declare_subscriber(state, zenoh.handlers.RingChannel(1))
            self._waker = session.declare_publisher(
                state, allowed_destination=zenoh.Locality.SESSION_LOCAL
            )
            self._declared = [self._setpoint, self._states, self._waker]

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

    def _queried(self, query: zenoh.Query) -> None:
        """In a thread of Zenoh's. Queued; served after the next State."""
        if self._answers.full():
            return  # who asked gets no answer
        request = self._answers.request(query, "control")
        if request.verb in CONTROL:
            self._asked.append((time.monotonic(), request))
        else:
            request.answer({"error": f"unknown request {request.verb!r}"})

    def _link_changed(self, event: zenoh.LinkEvent) -> None:
        self.linked |= event.kind == zenoh.SampleKind.PUT

    def _presence_changed(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self.presence.set()
        else:
            self.departures += 1
            self.presence.clear()
        self.wake()


class _Answers:
    """Sends answers by a thread of its own: who asks and then freezes holds up nobody else."""

    def __init__(self) -> None:
        self._due: SimpleQueue[tuple[zenoh.Query, bytes] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._send, name="answer", daemon=True)
        self._thread.start()

    def request(self, query: zenoh.Query, whom: str) -> Request:
        """A query to `…/<whom>/<verb>/<who>` as a request, whose answer is sent from here.

        One of version 1 goes to `…/<whom>/<verb>`, and its payload is `<who>`.
        """

        def answer(content: dict[str, Any] | bytes) -> None:
            payload = content if isinstance(content, bytes) else json.dumps(content).encode()
            self._due.put((query, payload))

        body = query.payload.to_bytes() if query.payload else b""
        _, _, asked = str(query.key_expr).partition(f"/{whom}/")
        verb, new, who = (asked or _leaf(query.key_expr)).partition("/")
        version = WIRE_VERSION if new else OLDEST
        return Request(verb, _identity(who.encode() or body), answer, body, version=version)

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


def ask(
    session: zenoh.Session,
    robot: str,
    verb: str,
    who: str,
    body: bytes = b"",
    whom: Literal["ask", "control"] = "ask",
) -> bytes | None:
    """Ask a robot ("ask"), or its controller ("control").

    Args:
        session: that reaches it.
        robot: its name.
        verb, who, body: see `hoap3.protocol.link.base.Request`.
        whom: see above.

    Returns:
        The answer; None where nobody gives one in time.
    """
    return ask_versions(session, robot, verb, who, body, QUERY_TIMEOUT_S, whom)[1]


def ask_versions(
    session: zenoh.Session,
    robot: str,
    verb: str,
    who: str,
    body: bytes = b"",
    timeout_s: float = QUERY_TIMEOUT_S,
    whom: Literal["ask", "control"] = "ask",
) -> tuple[int, bytes | None]:
    """The same, and the version of the wire that the answer came in.

    Where nobody takes the question of today, it is put as in version 1, without the client's name
    in the key; whoever takes it and is silent is not asked twice.
    """
    asked = time.monotonic()
    root = key(robot, f"{whom}/{verb}")
    answer = _first(session.get(f"{root}/{who}", payload=body, timeout=timeout_s))
    left_s = timeout_s - (time.monotonic() - asked)
    if answer is not None or left_s <= 0.0:
        return WIRE_VERSION, answer
    old = body if whom == "control" else who.encode()
    return OLDEST, _first(session.get(root, payload=old, timeout=left_s))


def _first(replies: Iterable[zenoh.Reply]) -> bytes | None:
    """The first answer of those that are one; None where there is none."""
    for reply in replies:
        if reply.ok is not None:
            return reply.ok.payload.to_bytes()
    return None


def alive_robots(session: zenoh.Session) -> list[str]:
    """Names of the robots that are alive where the session reaches."""
    replies = session.liveliness().get(key("*", "alive"), timeout=QUERY_TIMEOUT_S)
    return sorted(str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok)


def _fast_publisher(session: zenoh.Session, expression: str, blocking: bool) -> zenoh.Publisher:
    """Publisher whose samples are neither batched nor queued behind others."""
    control = zenoh.CongestionControl
    return session.declare_publisher(
        expression,
        express=True,
        priority=zenoh.Priority.REAL_TIME,
        congestion_control=control.BLOCK if blocking else control.DROP,
    )


def _link_changed(event: zenoh.LinkEvent) -> None:
    """For each new link, in a thread of Zenoh's."""
    if event.kind == zenoh.SampleKind.PUT:
        forbid_lingering()


def _way_to_sender() -> Callable[[], None]:
    """What lets Zenoh's thread send at once.

    It has our CPU and, under SCHED_FIFO, our priority: it would wait until we sleep. Under any
    other policy giving way may cost a slice of time, and the thread need not wait.
    """
    return os.sched_yield if os.sched_getscheduler(0) == os.SCHED_FIFO else _nothing


def _nothing() -> None:
    """Nobody waits for an arrival in real time, nor for us to give way."""


def _remember(clients: dict[str, int], who: str, taken: int) -> None:
    clients[who] = taken
    if len(clients) > MAX_CLIENTS:
        del clients[next(iter(clients))]


def _alive(session: zenoh.Session, robot: str) -> bool:
    replies = session.liveliness().get(key(robot, "alive"), timeout=0.5)
    return any(reply.ok is not None for reply in replies)


def _of(expression: Any, root: str) -> bool:
    """Whether a key is `root`, or below it."""
    text = str(expression)
    return text == root or text.startswith(f"{root}/")


def _leaf(expression: Any) -> str:
    """Last chunk of a key expression; a wildcard such as `**` may be all there is of it."""
    return str(expression).rsplit("/", 1)[-1]


def _client(token: Any) -> str:
    """Name of the client that holds a token."""
    return _identity(_leaf(token).encode())


def _identity(name: bytes) -> str:
    """Name of a client, cut alike wherever it comes from."""
    return name[:64].decode("utf-8", "replace")
