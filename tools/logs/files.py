"""Files of a log: locks while they are written, and replacement in one step."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

TRIES, PAUSE_S = 20, 0.002


def lock_shared(fd: int) -> None:
    """Show others that a log is being written, where its file system knows locks.

    Who looks holds the lock for a moment, so that it is tried some times.
    """
    for _ in range(TRIES):
        try:
            fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(PAUSE_S)
        except OSError:
            return  # `is_locked` takes that for a lock
        else:
            return


class LockedFolder:
    """A folder that somebody writes logs into, between two of them, too."""

    def __init__(self, folder: Path) -> None:
        try:
            self._fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        except OSError:
            self._fd = -1  # the lock of each log has to do
        else:
            lock_shared(self._fd)

    def free(self) -> None:
        """Write there no more; twice does no harm."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def is_locked(log: Path, *, unknown: bool = True) -> bool:
    """Whether somebody writes a log, or into a folder; `unknown` where locks are not known."""
    try:
        fd = os.open(log, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    except OSError:
        return unknown
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return unknown
    finally:
        os.close(fd)
    return False


@contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """Where to write what shall become `target`; it replaces it in one step, at the end.

    What is no ordinary file, such as a pipe, is written to directly.

    Raises:
        OSError: the place cannot be written; nothing is left behind.
    """
    if target.exists() and not target.is_file():
        yield target
        return
    real = target.resolve()  # a link stays one
    draft = real.with_name(f".{real.name}.{os.getpid()}")
    try:
        yield draft
        draft.replace(real)
    finally:
        draft.unlink(missing_ok=True)
