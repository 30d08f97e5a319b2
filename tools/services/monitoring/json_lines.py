"""What a service tells people as JSON too, an object a line: for journald, Loki, Elastic.

Both processes of a service append to one file, the service what it says itself, its observer the
events of the loop; only the observer begins a further file. No loop writes: see `QueuedLines`.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import queue
import stat
import sys
import threading
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from hoap3.protocol.config.settings import STANDARD_OUTPUT

KEPT = 4  # former files, FILE.1 the newest of them
MB = 1_000_000
Severity = Literal["debug", "info", "warning", "error"]
OF_NEWS: dict[str, tuple[Severity, str]] = {
    "detail": ("debug", "said"),
    "compiling": ("info", "compiling"),
    "routine": ("info", "said"),
    "said": ("warning", "said"),
    "not granted": ("warning", "not_granted"),
    "damaged": ("error", "log_lost"),
    "unserved": ("error", "metrics_lost"),
    "failed": ("error", "failed"),
}
"""Severity and name of what is no event of a loop, by its kind between processes."""


def facts_of(side: str, robot: str) -> dict[str, str]:
    """What every line of a service says of it."""
    return {"service": "emulator" if side == "robot" else side, "robot": robot}


class JsonLines:
    """Appends lines to a file or to standard output; what goes wrong is said, and ends nothing.

    A line that could not be written is counted, and the next one that can be says how many.

    Args:
        place: path of a file, made where it is missing; or `STANDARD_OUTPUT`.
        facts: members of every line, such as `service` and `robot`.
        complain: takes why lines are missing, for people; once, until they are written again.
        most_bytes: size of the file from which on a further one begins; None: none does.
    """

    def __init__(
        self,
        place: str,
        facts: Mapping[str, str],
        complain: Callable[[str], None],
        most_bytes: int | None = None,
    ) -> None:
        self._path = None if place == STANDARD_OUTPUT else Path(place)
        self._facts, self._complain, self._most_bytes = dict(facts), complain, most_bytes
        self._fd = -1 if self._path is not None else 1
        self._lost, self._told = 0, ""

    def open(self) -> None:
        """Open the file, so that it is there before anything is written.

        Raises:
            OSError: it cannot be written, or is no regular file; standard output is closed.
        """
        if self._path is None:
            if sys.stdout is None:  # its number may be another file's
                raise OSError(errno.EBADF, os.strerror(errno.EBADF))
            return
        if self._is_current(self._path):
            return
        self.close()
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NONBLOCK
        fd = os.open(self._path, flags, 0o666)
        if not stat.S_ISREG(os.fstat(fd).st_mode):
            os.close(fd)
            raise OSError(errno.EINVAL, "Not a regular file")
        self._fd = fd

    def write(
        self,
        severity: Severity,
        event: str,
        text: str,
        *,
        stamp: int | None = None,
        more: Mapping[str, int | str] | None = None,
    ) -> None:
        """Append one line.

        Args:
            severity, event, text: of what happened.
            stamp: monotonic clock when it happened [ns]; None: now.
            more: further members, such as `session` and `tick`.
        """
        said = self._line(severity, event, text, stamp, more or {})
        if self._lost:
            lost = f"{self._lost} lines could not be written: {self._told}"
            said = self._line("warning", "lines_lost", lost, None, {"lines": self._lost}) + said
        problem = ""
        try:
            self.open()
            problem = self._begin_further_file()
            self._append(said)
        except OSError as error:
            problem = f"{error.strerror or error}"
            self._lost += 1
        else:
            self._lost = 0
        if problem and not self._told:
            place = STANDARD_OUTPUT if self._path is None else self._path
            self._complain(f"JSON lines are missing in {place}: {problem}; it goes on without")
        self._told = problem

    def close(self) -> None:
        """Close the file; the next line would open it again."""
        if self._path is not None and self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _line(
        self,
        severity: str,
        event: str,
        text: str,
        stamp: int | None,
        more: Mapping[str, int | str],
    ) -> bytes:
        line = {
            "time": datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "monotonic_ns": time.monotonic_ns() if stamp is None else stamp,
            "severity": severity,
            **self._facts,
            "event": event,
            **more,
            "text": text,
        }
        return json.dumps(line).encode() + b"\n"

    def _is_current(self, path: Path) -> bool:
        """Whether what is open is what bears the name: another process may have renamed it."""
        if self._fd < 0:
            return False
        try:
            there = path.stat()
        except FileNotFoundError:
            return False
        ours = os.fstat(self._fd)
        return (ours.st_dev, ours.st_ino) == (there.st_dev, there.st_ino)

    def _append(self, said: bytes) -> None:
        """Append it whole, or not at all.

        Raises:
            OSError: there is no room.
        """
        before = os.fstat(self._fd).st_size
        written = os.write(self._fd, said)
        if written == len(said):
            return
        if self._path is not None and os.fstat(self._fd).st_size == before + written:
            os.ftruncate(self._fd, before)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def _begin_further_file(self) -> str:
        """Where the file is full, rename it and open another; why not, where that fails.

        Raises:
            OSError: the other one cannot be opened.
        """
        if self._path is None or self._most_bytes is None:
            return ""
        if os.fstat(self._fd).st_size < self._most_bytes:
            return ""
        names = [self._path, *(Path(f"{self._path}.{number + 1}") for number in range(KEPT))]
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)  # until it is closed
            if self._is_current(self._path):
                for older, newer in reversed(list(zip(names[1:], names, strict=False))):
                    if newer.exists():
                        newer.replace(older)
        except BlockingIOError:
            return ""  # another service that writes there does it
        except OSError as error:
            return f"no further file can begin: {error.strerror}"
        self.open()
        return ""


class QueuedLines:
    """The same for a process whose loop must not wait for a disk: a thread writes.

    The thread sleeps until there is a line.
    """

    def __init__(self, lines: JsonLines) -> None:
        self._lines = lines
        self._queue: queue.SimpleQueue[tuple[Any, ...] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="json lines", daemon=True)
        self._thread.start()

    def write(self, severity: Severity, event: str, text: str) -> None:
        """Have a line appended."""
        self._queue.put((severity, event, text, time.monotonic_ns()))

    def close(self) -> None:
        """Return once all of it is written."""
        self._queue.put(None)
        self._thread.join()
        self._lines.close()

    def _run(self) -> None:
        while (said := self._queue.get()) is not None:
            severity, event, text, stamp = said
            self._lines.write(severity, event, text, stamp=stamp)
