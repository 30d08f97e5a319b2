"""What a robot knows of its clients over Zenoh: what they ask, and whether they are there."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from queue import SimpleQueue
from typing import Any

from hoap3.protocol.link.client_tokens import ClientTokens
from hoap3.protocol.link.zenoh_session import QUERY_TIMEOUT_S, key, zenoh

WAITING_STOPS = 16  # queries; of more the oldest are dropped, which ends them without an answer
WAITING_QUERIES = 64
TOKENS = 256  # that came or went and wait for the loop; of more the oldest are lost
TOKENS_AT_ONCE = 8  # that are taken before each request
LOOKS = 8  # clients whose tokens are looked up together
LOOK_PAUSE_S = 0.05  # before each look-up: requests may come by the thousand


class Queries:
    """Queries to the robot, `stop` first. A full queue drops its oldest, whose client learns that.

    Zenoh's thread never waits for room here: it also carries what the holder sends.
    """

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        ring, self._stop = zenoh.handlers.RingChannel, key(robot, "ask/stop")
        self._stops = session.declare_queryable(f"{self._stop}/**", ring(WAITING_STOPS))
        self._others = session.declare_queryable(key(robot, "ask/**"), ring(WAITING_QUERIES))

    def try_recv(self, *, stops: bool = True, others: bool = True) -> zenoh.Query | None:
        """The next query of the wanted ones; both queues get each `stop`, the first one counts."""
        for queue, wanted, of_stop in ((self._stops, stops, True), (self._others, others, False)):
            while wanted and (query := queue.try_recv()) is not None:
                if self.is_stop(query) == of_stop:
                    return query
        return None

    def is_stop(self, query: zenoh.Query) -> bool:
        """Whether it asks the robot to stop."""
        return is_below(query.key_expr, self._stop)


class Clients:
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
        self._known = ClientTokens()
        self._changes = deque[tuple[str, bool]](maxlen=TOKENS)
        self._wanted: SimpleQueue[str | None] = SimpleQueue()
        self._found: SimpleQueue[tuple[str, bool, int]] = SimpleQueue()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._look, name="clients", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def asks(self, who: str) -> bool:
        """Note that a client asks for authority; whether its token is seen."""
        return self._known.asks(who)

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
            who, came = client_of(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
            self._changes.append((who, came))
            if self._known.take(who, came=came):
                yield who
        while not self._found.empty():
            who, alive, taken = self._found.get()
            if self._known.found(who, alive=alive, taken=taken):
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
        taken = self._known.taken  # what comes or goes after this is newer than what is found
        token = key(self._robot, f"clients/{who}")
        replies = list(self._liveliness.get(token, timeout=QUERY_TIMEOUT_S))
        if all(reply.ok for reply in replies):  # else it took too long
            names = {client_of(reply.ok.key_expr) for reply in replies if reply.ok}
            self._found.put((who, who in names, taken))  # a wildcard finds others


def is_below(expression: Any, root: str) -> bool:
    """Whether a key is `root`, or below it."""
    text = str(expression)
    return text == root or text.startswith(f"{root}/")


def leaf(expression: Any) -> str:
    """Last chunk of a key expression; a wildcard such as `**` may be all there is of it."""
    return str(expression).rsplit("/", 1)[-1]


def client_of(token: Any) -> str:
    """Name of the client that holds a token."""
    return identity(leaf(token).encode())


def identity(name: bytes) -> str:
    """Name of a client, cut alike wherever it comes from."""
    return name[:64].decode("utf-8", "replace")
