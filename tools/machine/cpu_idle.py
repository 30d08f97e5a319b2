"""A CPU that spins when it is idle, instead of falling asleep.

What runs after a sleep finds its caches cold, and on a virtual machine the host may have lent the
CPU to others meanwhile: the same tick takes three times as long.

What was set before is noted in a file that all who keep the CPU awake hold locked, in this user's
runtime directory. The last one sets it again; where that one was killed, `let_sleep` or the next
one finds the note, and does so. No lock is waited for without a limit.
"""

from __future__ import annotations

import errno
import fcntl
import os
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hoap3.protocol.runtime.private_directory import runtime_directory

SYSTEM = Path("/sys/devices/system/cpu")
NO_LATENCY = "n/a"  # the kernel's word for: not even the shortest sleep
PATIENCE_S = 1.0  # with others who hold a note for a moment
_LONGEST_US = 2**31 - 1  # that the kernel takes
_NAME = "awake"


@contextmanager
def kept_awake(cpu: int, system: Path | None = None, notes: Path | None = None) -> Iterator[str]:
    """Keep a CPU awake as long as this, or anybody else's, is held.

    A CPU that is awake already, without a note of ours, is left as it is.

    Args:
        cpu: its number.
        system: where the settings of CPUs are, by default `SYSTEM`.
        notes: where it is noted what was set before, by default the runtime directory.

    Yields:
        "" or why it was refused.
    """
    setting, folder = _setting(cpu, system), notes or runtime_directory()
    if folder is None:
        yield "no directory of this user alone for its note; name one in HOAP3_RUNTIME_DIR"
        return
    try:
        note = _open(folder / f"{_NAME}{cpu}", os.O_CREAT)
    except OSError as error:
        yield _refusal(error, setting)
        return
    try:
        try:
            os.close(os.open(setting, os.O_WRONLY))  # refused before there is a note
            ours = _share(note, setting)
            if ours:
                setting.write_text(NO_LATENCY, encoding="ascii")
        except OSError as error:
            yield _refusal(error, setting)
        else:
            yield ""
    finally:
        _restore(note, setting)
        os.close(note)


def let_sleep(system: Path | None = None, notes: Path | None = None) -> None:
    """Set what was before for each CPU that nobody keeps awake any more: who did was killed.

    Args:
        system, notes: as for `kept_awake`.

    Raises:
        OSError: a setting cannot be written.
    """
    folder = notes or runtime_directory()
    for path in folder.glob(f"{_NAME}*") if folder is not None else ():
        cpu = path.name.removeprefix(_NAME)
        try:
            note = _open(path)
        except OSError:
            continue  # no note of ours
        try:
            if cpu.isdecimal():
                _restore(note, _setting(int(cpu), system))
        finally:
            os.close(note)


def _share(note: int, setting: Path) -> bool:
    """Hold the note together with others; False where somebody else had the CPU awake before."""
    limit = time.monotonic() + PATIENCE_S
    while time.monotonic() < limit:
        if _lock(note, fcntl.LOCK_EX) and not _noted(note):  # the first one, and no killed one's
            before = setting.read_text(encoding="ascii").strip()
            if before == NO_LATENCY:
                fcntl.flock(note, fcntl.LOCK_UN)
                return False
            os.ftruncate(note, 0)
            os.pwrite(note, before.encode(), 0)
        if _lock(note, fcntl.LOCK_SH) and _noted(note):  # the last one took it along otherwise
            return True
        time.sleep(0.001)
    raise TimeoutError(errno.ETIMEDOUT, "its note is locked by another process")


def _restore(note: int, setting: Path) -> None:
    """Set what was before, where nobody else holds the note."""
    if not _lock(note, fcntl.LOCK_EX):
        return
    before = _noted(note)
    if before:
        setting.write_text(before, encoding="ascii")
    os.ftruncate(note, 0)


def _noted(note: int) -> str:
    """What was set before [us]; "" where there is no such figure."""
    text = os.pread(note, 16, 0).decode("ascii", "replace").strip()
    return text if text.isdecimal() and int(text) <= _LONGEST_US else ""


def _open(path: Path, flags: int = 0) -> int:
    """Open a note, which is a plain file of this user."""
    flags |= os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    note = os.open(path, flags, 0o600)
    found = os.fstat(note)
    if stat.S_ISREG(found.st_mode) and found.st_uid == os.geteuid():
        return note
    os.close(note)
    raise PermissionError(errno.EPERM, f"{path} is no plain file of this user")


def _lock(note: int, kind: int) -> bool:
    try:
        fcntl.flock(note, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _refusal(error: OSError, setting: Path) -> str:
    return f"{error.strerror or error}; it takes root, or the right to write {setting}"


def _setting(cpu: int, system: Path | None) -> Path:
    return (system or SYSTEM) / f"cpu{cpu}" / "power" / "pm_qos_resume_latency_us"
