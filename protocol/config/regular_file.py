"""Opens files that users name, and nothing that could block or never end.

A FIFO would block the reader until somebody writes, and a device may deliver bytes for ever.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

from hoap3.protocol.errors import ConfigError


def open_regular(path: Path) -> BinaryIO:
    """Open a regular file for reading, in binary mode.

    Raises:
        IsADirectoryError: it is a folder.
        OSError: it is missing, may not be read, or is a FIFO, a socket or a device; `strerror`
            says which.
    """
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "has a NUL character in its name", str(path))
    _check(os.stat(path).st_mode, path)  # before it is opened: opening a device may act on it
    fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    try:
        _check(os.fstat(fd).st_mode, path)  # it may have been replaced in between
        return os.fdopen(fd, "rb")
    except OSError:
        os.close(fd)
        raise


def read_at_most(path: Path, limit: int) -> bytes:
    """The first `limit + 1` bytes of a regular file: more than `limit` shows that it is too large.

    Raises:
        OSError: see `open_regular`; or Git LFS has left a pointer in its place.
    """
    with open_regular(path) as stream:
        data = stream.read(limit + 1)
    if data.startswith(b"version https://git-lfs"):
        raise OSError(errno.EINVAL, "is a Git LFS pointer: run `git lfs pull` there", str(path))
    return data


def read_named(path: Path, limit: int, label: str, what: str) -> bytes:
    """The same of a file that somebody named.

    Args:
        path, limit: as of `read_at_most`.
        label: what the user calls the file.
        what: it should be, such as "a YAML file".

    Raises:
        ConfigError: it cannot be read.
    """
    try:
        return read_at_most(path, limit)
    except OSError as error:
        folder = isinstance(error, IsADirectoryError)
        reason = "is a folder" if folder else error.strerror or "cannot be read"
        raise ConfigError(label, "", None, reason, f"Name {what} that can be read") from error


def check_path(name: str, what: str) -> None:
    """Refuse a path that leads nowhere; a name without a slash may be known otherwise.

    Args:
        name: what the user wrote.
        what: it should be, such as "a YAML file".

    Raises:
        ConfigError: there is no such file or folder.
    """
    if "/" in name and not os.path.exists(name):
        raise ConfigError(name, "", None, "no such file or folder", f"Name {what}")


def _check(mode: int, path: Path) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, f"is {_kind(mode)}, not a regular file", str(path))


def _kind(mode: int) -> str:
    if stat.S_ISFIFO(mode):
        return "a FIFO"
    return "a socket" if stat.S_ISSOCK(mode) else "a device"
