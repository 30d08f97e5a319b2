"""Directories that belong to one user alone, and the one for files of running processes."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path


def is_private(path: Path) -> bool:
    """Make the directory; is it this user's alone (mode 0700, no link), and can it be written?"""
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = path.lstat()
        tempfile.TemporaryFile(dir=path).close()
    except OSError:
        return False
    owned = stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid()
    return owned and not found.st_mode & 0o077


def runtime_directory() -> Path | None:
    """Where locks and sockets of running processes stand: this user's alone, gone after a boot.

    ``$HOAP3_RUNTIME_DIR``, else ``$XDG_RUNTIME_DIR/hoap3``, else ``/run/hoap3`` for root and
    ``/run/user/UID/hoap3`` for others, else ``hoap3-UID`` in the temporary directory.

    Returns:
        The first of them that is private, made where it is missing. None where none is, such as
        where another user has made it: nothing is then shared with other processes.
    """
    own = os.environ.get("HOAP3_RUNTIME_DIR")
    if own:
        chosen = Path(own).absolute()
        return chosen if is_private(chosen) else None
    user = os.geteuid()
    session = Path(os.environ.get("XDG_RUNTIME_DIR", ""))
    bases = [session] if session.is_absolute() and user == _owner(session) else []
    bases.append(Path("/run") if user == 0 else Path(f"/run/user/{user}"))
    places = [base / "hoap3" for base in bases if base.is_dir()]
    places.append(Path(tempfile.gettempdir()) / f"hoap3-{user}")
    return next((place for place in places if is_private(place)), None)


def no_directory() -> str:
    """Return why there is no runtime directory and what to do; "" where there is one."""
    if runtime_directory() is not None:
        return ""
    chosen = os.environ.get("HOAP3_RUNTIME_DIR") or "unset"
    return (
        f"processes cannot find each other: no directory for their sockets (HOAP3_RUNTIME_DIR: "
        f"{chosen}); it must belong to this user alone: `chmod 700` it, or name another"
    )


def _owner(path: Path) -> int:
    """User who owns a directory; under ``sudo -E`` not the process's. -1: there is none."""
    try:
        return path.stat().st_uid
    except OSError:
        return -1
