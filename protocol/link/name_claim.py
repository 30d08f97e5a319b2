"""A robot's claim to its name on the network, and the other robots that use the same name."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.errors import LinkError, NameTakenError
from hoap3.protocol.link.robot_sessions import RobotSession, name_conflict
from hoap3.protocol.link.zenoh_session import is_alive, key, open_session, robot_sessions, zenoh
from hoap3.protocol.messages import State
from hoap3.protocol.secure.refusals import listens

CONNECT_S = 1.0  # for connections at the start, before the name is checked
RETRY_S = 0.5
MAX_REPORTS = 16  # any client may declare such tokens


class NameClaim:
    """The token of a robot's session, and those of other robots with the same name.

    Routers do not pass tokens on from one peer to another. A robot in mode `peer` that connects to
    a router watches it through a second session in mode `client`.

    Args:
        session: of the robot.
        robot: its name.
        settings: of its link.
        session_id: of its messages.
        report: takes which other robots come and go, in a thread of Zenoh's.

    Attributes:
        conflicts: how many other robots on the network use the name.

    Raises:
        NameTakenError: a robot of that name is alive.
    """

    def __init__(
        self,
        session: zenoh.Session,
        robot: str,
        settings: LinkSettings,
        session_id: int,
        report: Callable[[str], None],
    ) -> None:
        self._robot, self._settings, self._report = robot, settings, report
        where, host = "".join(settings.places[:1]), socket.gethostname()
        self._own = RobotSession(time.time_ns(), session_id, os.getpid(), host, where)
        self._seen: frozenset[tuple[int, RobotSession]] = frozenset()  # by place of the session
        self._others: frozenset[RobotSession] = frozenset()
        self.conflicts = self._reports = 0
        self._is_newer = False
        self._thread: threading.Thread | None = None
        self._changing, self._closing = threading.Lock(), threading.Event()
        self._sessions, self._kept = [session], list[object]()
        self._missing = list(settings.connect) if settings.mode == "peer" else []
        until = time.monotonic() + CONNECT_S
        while self._missing and not session.info.links() and time.monotonic() < until:
            time.sleep(0.02)
        try:
            self._open_watches()
            self._claim()
        except BaseException:
            self.close()
            raise
        for each in range(len(self._sessions)):
            self._subscribe(each)
        if self._missing:
            self._thread = threading.Thread(target=self._keep_opening, name="name", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Close the sessions that watch routers."""
        self._closing.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(timeout=2.0 * CONNECT_S)
        for session in self._sessions[1:]:
            session.close()

    def is_quiet(self, state: bytes) -> bool:
        """Whether a State is not to be sent: it would disturb the controller of the incumbent.

        That is so for a newer robot of the same name that has no holder.
        """
        return self._is_newer and State.scalars(state, "epoch_from_tick") == (0,)

    def _claim(self) -> None:
        """Declare the token, then look for others: of two that start together one sees the other.

        Raises:
            NameTakenError: see above.
        """
        token = key(self._robot, f"session/{self._own.leaf}")
        self._kept.append(self._sessions[0].liveliness().declare_token(token))
        found = {one for each in self._sessions for _, one in robot_sessions(each, self._robot)}
        others = found - {self._own}
        alive = any(is_alive(each, self._robot) for each in self._sessions)
        if alive or (others and min(others) < self._own):
            where = f" at {min(others)}" if others else ""
            raise NameTakenError(
                f"a robot called {self._robot!r} is alive already{where}; stop it, or give this "
                "one another name: --set name=NAME"
            )

    def _open_watches(self) -> None:
        """Connect to the routers that answer."""
        for place in filter(listens, tuple(self._missing)):
            watch = {"mode": "client", "listen": (), "connect": (place,)}
            with suppress(LinkError):  # it is tried again
                settings = self._settings.model_copy(update=watch)
                self._sessions.append(open_session(settings, self._robot, loops=True))
                self._missing.remove(place)

    def _keep_opening(self) -> None:
        """In a thread of its own, until all routers are watched."""
        while self._missing and not self._closing.wait(RETRY_S):
            before = len(self._sessions)
            self._open_watches()
            for each in range(before, len(self._sessions)):
                self._subscribe(each)
        if self._closing.is_set():
            self.close()

    def _subscribe(self, place: int) -> None:
        def changed(sample: zenoh.Sample) -> None:
            self._changed(place, sample)

        callback = zenoh.handlers.Callback(changed, indirect=True)
        liveliness = self._sessions[place].liveliness()
        tokens = key(self._robot, "session/*")
        self._kept.append(liveliness.declare_subscriber(tokens, callback, history=True))

    def _changed(self, place: int, sample: zenoh.Sample) -> None:
        found = RobotSession.read(sample.key_expr)
        if found is None or found == self._own:
            return
        with self._changing:
            came, before = sample.kind == zenoh.SampleKind.PUT, self._others
            self._seen = self._seen | {(place, found)} if came else self._seen - {(place, found)}
            self._others = frozenset(one for _, one in self._seen)
            self.conflicts = len(self._others)
            self._is_newer = min(self._others, default=self._own) < self._own
        self._reports += self._others != before
        if self._others != before and self._reports <= MAX_REPORTS:
            conflict = name_conflict(self._robot, [self._own, *self._others])
            alone = f"no other robot on this network is called {self._robot!r} any more"
            self._report(f"{conflict}. No new grants meanwhile" if self._others else alone)
