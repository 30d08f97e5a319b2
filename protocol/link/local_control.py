"""Stop, ask and release a robot from its own machine, without the network.

A robot listens on a Unix socket in its user's runtime directory. Only that user and root can
connect. A request is one line, a JSON object such as `{"verb": "stop"}`; so is the answer. The
socket has a thread of its own, which hands requests to the robot's loop through a queue and waits
for the answer. The loop never waits for the thread. While a robot starts, which takes a minute
where its kernels have to be compiled, the thread answers `status` itself and refuses the rest.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import socket
import struct
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from hoap3.protocol.errors import LinkError
from hoap3.protocol.link.base import Request
from hoap3.protocol.runtime.private_directory import runtime_directory

VERBS = ("stop", "recover", "status", "release")
WHO = "local"  # the client's name in a request
MAX_LINE_BYTES = 65_536
ANSWER_TIMEOUT_S = 2.0  # a robot in lockstep may wait for its controller meanwhile
LINE_TIMEOUT_S = 0.5  # for a client to send its line, and to take the answer
NOT_STARTED = "is starting and does not move yet; compiling its kernels may take a minute"
WAITING = 16  # connections
ACCEPT_PAUSE_S = 0.1  # until a client is accepted that could not be
_FILE = re.compile(r"robot-([a-z][a-z0-9_]{0,31})-(\d+)\.sock")
_CREDENTIALS = struct.Struct("3i")  # pid, uid, gid: struct ucred
_Answers = SimpleQueue[dict[str, Any] | bytes]


class LocalControl:
    """The robot's side: takes requests on the socket; the robot's loop serves them.

    Sockets of robots that no longer run are removed first.

    Args:
        robot: its name.
        endpoints: where it is reached over the network; told with each answer.
        starting: the answer to `status` of a robot that has not started; None once it has.

    Attributes:
        path: of the socket; None where there is no private directory for it.
    """

    def __init__(
        self, robot: str, endpoints: Sequence[str], starting: Mapping[str, Any] | None = None
    ) -> None:
        self._starting = starting
        self._told = {"robot": robot, "endpoints": list(endpoints)}
        self._asked: SimpleQueue[Request] = SimpleQueue()
        self._ended = threading.Event()
        self.path: Path | None = None
        directory = runtime_directory()
        if directory is None:
            return
        local_robots()
        self._server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        path = directory / f"robot-{robot}-{os.getpid()}.sock"
        hidden = path.with_suffix(".starting")  # until it listens: nobody takes it for stale
        try:
            hidden.unlink(missing_ok=True)
            self._server.bind(str(hidden))
            hidden.chmod(0o600)
            self._server.listen(WAITING)
            hidden.rename(path)
        except OSError:  # such as a path too long for a socket
            self._server.close()
            return
        self.path = path
        self._thread = threading.Thread(target=self._serve, name="local control", daemon=True)
        self._thread.start()

    def requests(self) -> Iterator[Request]:
        """Requests that have arrived since the last call; never blocks."""
        while not self._asked.empty():
            yield self._asked.get_nowait()

    def close(self) -> None:
        """Remove the socket, and end the thread."""
        if self.path is None or self._ended.is_set():
            return
        self._ended.set()
        self.path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)  # wakes the thread
        self._server.close()
        for request in self.requests():
            request.answer({"error": "the robot ends"})
        self._thread.join(timeout=2.0)

    def _serve(self) -> None:
        while not self._ended.is_set():
            try:
                client, _ = self._server.accept()
            except OSError:
                # closed; or this process may open no more files now, and the client waits
                self._ended.wait(ACCEPT_PAUSE_S)
                continue
            with client, contextlib.suppress(OSError):  # a client may leave at any time
                client.settimeout(LINE_TIMEOUT_S)
                if _user(client) in (0, os.geteuid()):
                    answer = {**self._answer(_read_line(client)), **self._told}
                    client.sendall(json.dumps(answer).encode() + b"\n")

    def _answer(self, line: bytes) -> dict[str, Any]:
        """Have the loop serve one request."""
        try:
            content = json.loads(line)
        except (ValueError, RecursionError):
            return {"error": "the request is not JSON"}
        verb = content.get("verb") if isinstance(content, dict) else None
        if verb not in VERBS:
            return {"error": f"the request has no verb of {', '.join(VERBS)}"}
        if self._starting is not None:
            return dict(self._starting) if verb == "status" else {"error": f"it {NOT_STARTED}"}
        answers: _Answers = SimpleQueue()
        self._asked.put(Request(verb, WHO, answers.put, local=True))
        try:
            found = answers.get(timeout=ANSWER_TIMEOUT_S)
        except Empty:
            return {"error": f"the robot has not answered within {ANSWER_TIMEOUT_S:g} s"}
        return found if isinstance(found, dict) else {"error": "the robot answers in bytes"}


@dataclass(frozen=True)
class LocalRobot:
    """A robot of this user that runs on this machine.

    Attributes:
        name: of the robot.
        pid: of its process.
        path: of its socket.
    """

    name: str
    pid: int
    path: Path

    def __str__(self) -> str:
        try:
            endpoints = self.ask("status").get("endpoints")
        except LinkError:
            endpoints = None
        return f"{self.name} at {', '.join(endpoints or ['no endpoint'])} (process {self.pid})"

    @property
    def starting(self) -> bool:
        """Whether it says that it has not started yet."""
        try:
            return bool(self.ask("status").get("mode") == "starting")
        except LinkError:
            return False

    def ask(self, verb: str) -> dict[str, Any]:
        """Ask it something.

        Args:
            verb: one of `VERBS`.

        Returns:
            Its answer, with `robot`, its name, and `endpoints`, where the network reaches it.

        Raises:
            LinkError: it does not answer, or refuses.
        """
        who = f"robot {self.name!r} (process {self.pid})"
        try:
            with _connected(self.path) as connection:
                connection.settimeout(ANSWER_TIMEOUT_S + 2 * LINE_TIMEOUT_S)
                connection.sendall(json.dumps({"verb": verb}).encode() + b"\n")
                answer = json.loads(_read_line(connection))
        except (OSError, ValueError) as error:
            raise LinkError(f"{who} does not answer at {self.path} ({error})") from error
        if not isinstance(answer, dict) or "error" in answer:
            reason = answer.get("error") if isinstance(answer, dict) else "no JSON object"
            raise LinkError(f"{who} does not {verb}: {reason}")
        return answer


def local_robots() -> list[LocalRobot]:
    """Robots of this user that run on this machine, in the order of their names.

    Sockets that nobody listens on are removed: their robots were killed.
    """
    directory = runtime_directory()
    found = []
    for path in sorted(directory.glob("robot-*.sock")) if directory else ():
        words = _FILE.fullmatch(path.name)
        if words is None:
            continue
        try:
            _connected(path).close()
        except ConnectionRefusedError:
            path.unlink(missing_ok=True)
        except OSError:
            continue  # it has gone meanwhile, or is too busy to be asked
        else:
            found.append(LocalRobot(words[1], int(words[2]), path))
    return found


def others_here(robot: str) -> str:
    """Which robots of this user run on this machine, one of that name with its endpoint; or ""."""
    found = local_robots()
    names = sorted({one.name for one in found} - {robot})
    same = [str(one) for one in found if one.name == robot]
    return f"robots that run on this machine: {', '.join([*names, *same])}" if found else ""


def _connected(path: Path) -> socket.socket:
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        connection.settimeout(LINE_TIMEOUT_S)
        connection.connect(str(path))
    except OSError:
        connection.close()
        raise
    return connection


def _read_line(connection: socket.socket) -> bytes:
    """What comes up to the first line feed, the end, or the largest size."""
    line = b""
    while b"\n" not in line and len(line) <= MAX_LINE_BYTES:
        more = connection.recv(4096)
        if not more:
            break
        line += more
    return line.partition(b"\n")[0]


def _user(connection: socket.socket) -> int:
    """User of the process at the other end."""
    data = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    return int(_CREDENTIALS.unpack(data)[1])
