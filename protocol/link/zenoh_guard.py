"""What a robot with certificates checks itself, behind Zenoh's access control.

Zenoh drops what its rules do not allow; they are fixed when the session opens. The guard knows the
list of today: it refuses names that have left it, and closes their connections. It also keeps the
setpoints of all but the holder from the robot, whatever epoch they state.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.link.base import Request
from hoap3.protocol.link.zenoh_session import zenoh
from hoap3.protocol.link.zenoh_sockets import shut_down
from hoap3.protocol.secure.access import ACCESS_FILE, read_access
from hoap3.protocol.secure.roles import Role, may_ask

LOOK_S = 0.25  # between two looks at the list and at who is connected


class Guard:
    """Who may do what, as the list says now.

    `admitted` belongs to the robot's loop, `follows` to its receive thread; neither blocks.

    Args:
        session: of the robot.
        directory: of its certificate, with the list.
        report: is told what becomes of the list, in a thread of ours.

    Raises:
        ConfigError: the list cannot be read.
    """

    def __init__(
        self, session: zenoh.Session, directory: str, report: Callable[[str], None]
    ) -> None:
        self._session, self._directory, self._report = session, Path(directory), report
        self._file = self._directory / ACCESS_FILE
        self._stamp = self._stamped()
        self._roles: Mapping[str, Role] = read_access(self._directory).roles
        self._known = dict(self._roles)  # what Zenoh's rules allow, for as long as we run
        self._holder = self._holder_name = ""  # who was granted authority last, and its certificate
        self._told = ""  # the trouble that was reported last
        self._left: frozenset[str] = frozenset()  # links that no socket of ours was found for
        self._refused = self._not_holder = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="access", daemon=True)

    def start(self) -> None:
        """Start to watch the list."""
        self._thread.start()

    def close(self) -> None:
        """Watch no longer; before the session is closed."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(timeout=2.0)

    def counts(self) -> dict[str, int]:
        """Setpoints that were not the holder's, and requests without a right to them."""
        return {"not_holder": self._not_holder, "no_right": self._refused}

    def follows(self, who: str) -> bool:
        """Whether setpoints on the key of `who` count: the holder's, while it is on the list."""
        if who and who == self._holder and self._holder_name in self._roles:
            return True
        self._not_holder += 1
        return False

    def admitted(self, request: Request) -> Request | None:
        """A request as the robot is to serve it; None where it was refused.

        An admin may release whoever holds authority, as a user of the robot's own machine may.
        """
        name, dot, _ = request.who.partition(".")
        role = self._roles.get(name)
        if role is None or not dot or not may_ask(role, request.verb):
            self._refused += 1
            listed = f"lists {name!r} as {role}" if role else f"does not list {name!r}"
            why = f"{request.who!r} has no right to {request.verb!r}: access.yaml {listed}"
            request.answer({"error": why})
            return None
        if request.verb == "acquire":
            return replace(request, answer=self._noting(request))
        if request.verb == "release" and role == "admin":
            return replace(request, local=True)
        return request

    def _noting(self, request: Request) -> Callable[[dict[str, Any] | bytes], None]:
        """Its answer, which first tells whose setpoints count."""

        def answer(content: dict[str, Any] | bytes) -> None:
            if isinstance(content, dict) and content.get("granted"):
                self._holder, self._holder_name = request.who, request.who.partition(".")[0]
            request.answer(content)

        return answer

    def _watch(self) -> None:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # not as urgent as the loop
        while not self._closing.wait(LOOK_S):
            trouble = ". ".join(filter(None, (self._look(), self._close_strangers())))
            if trouble and trouble != self._told:
                self._report(trouble)
            self._told = trouble

    def _look(self) -> str:
        """Take the list where it has changed; what is wrong with it, or ""."""
        stamp = self._stamped()
        if stamp == self._stamp:
            return ""
        try:
            roles = read_access(self._directory).roles
        except (ConfigError, OSError) as error:  # also for want of descriptors
            return f"{error}. Whom it let in before is let in still"
        self._take(roles)
        self._stamp = stamp
        return ""

    def _take(self, roles: Mapping[str, Role]) -> None:
        """Let in whom the list names, in the role that Zenoh's rules know."""
        before = self._roles
        self._roles = {n: role for n, role in roles.items() if self._known.get(n) == role}
        gone, later = before.keys() - self._roles.keys(), roles.keys() - self._roles.keys()
        if gone:
            self._report(f"lets in no longer: {', '.join(sorted(gone))}")
        if later:
            names = ", ".join(sorted(later))
            self._report(f"lets in {names} when it starts again, not before")

    def _close_strangers(self) -> str:
        """Close the connections of names that are not on the list; what hinders that, or ""."""
        left: set[str] = set()
        try:
            for link in self._session.info.links():
                if link.auth_identifier not in self._roles and not shut_down(str(link.dst)):
                    left.add(f"{link.auth_identifier!r} at {link.dst}")
        except (OSError, zenoh.ZError) as error:  # also for want of descriptors
            return f"who is connected cannot be looked at now ({error})"
        again, self._left = self._left & left, frozenset(left)  # else it has just gone by itself
        return f"cannot close the connection of {', '.join(sorted(again))}" if again else ""

    def _stamped(self) -> tuple[int, ...]:
        """What changes where the list is written."""
        try:
            status = self._file.stat()
        except OSError:
            return ()
        return status.st_mtime_ns, status.st_ctime_ns, status.st_ino, status.st_size
