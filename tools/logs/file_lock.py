"""Says that a file is being written: a lock that ends with the process, however that ends."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path


def lock_shared(fd: int) -> None:
    """Show others that a log is being written, where its file system knows locks."""
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return  # `is_locked` takes that for a lock


def is_locked(log: Path) -> bool:
    """Whether somebody writes a file, or may do so: locks are not known everywhere."""
    try:
        fd = os.open(log, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    except OSError:
        return True
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(fd)
    return False
