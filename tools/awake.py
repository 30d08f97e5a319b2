"""A CPU that spins when it is idle, instead of falling asleep.

What runs after a sleep finds its caches cold, and on a virtual machine the host may have lent the
CPU to others meanwhile: the same tick takes three times as long.

What was set before is noted in a file that all who keep the CPU awake hold locked. The last one
sets it again; where that one was killed, the next finds the note, and does so at its own end.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

SYSTEM = Path("/sys/devices/system/cpu")
NO_LATENCY = "n/a"  # the kernel's word for: not even the shortest sleep


def may_keep_awake(system: Path = SYSTEM) -> bool:
    """Whether every CPU that we may run on can be kept awake."""
    return all(os.access(_setting(cpu, system), os.W_OK) for cpu in os.sched_getaffinity(0))


@contextmanager
def kept_awake(cpu: int, system: Path = SYSTEM, notes: Path | None = None) -> Iterator[str]:
    """Keep a CPU awake as long as this, or anybody else's, is held.

    Args:
        cpu: its number.
        system: where the settings of CPUs are.
        notes: where it is noted what was set before; by default the temporary folder.

    Yields:
        "" or why it was refused.
    """
    setting = _setting(cpu, system)
    path = (notes or Path(tempfile.gettempdir())) / f"hoap3-awake{cpu}"
    try:
        before = setting.read_text(encoding="ascii").strip()
        note = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    except OSError as error:
        yield _refusal(error, setting)
        return
    refusal = "not yet"
    try:
        if _lock(note, fcntl.LOCK_EX) and not os.pread(note, 64, 0):  # nobody else, and no note
            os.pwrite(note, before.encode(), 0)
        fcntl.flock(note, fcntl.LOCK_SH)
        try:
            setting.write_text(NO_LATENCY, encoding="ascii")
            refusal = ""
        except OSError as error:
            refusal = _refusal(error, setting)
        yield refusal
    finally:
        if _lock(note, fcntl.LOCK_EX):  # the last one
            if not refusal:
                setting.write_text(os.pread(note, 64, 0).decode(), encoding="ascii")
            os.ftruncate(note, 0)
        os.close(note)


def _lock(note: int, kind: int) -> bool:
    try:
        fcntl.flock(note, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _refusal(error: OSError, setting: Path) -> str:
    return f"{error.strerror or error}; it takes root, or the right to write {setting}"


def _setting(cpu: int, system: Path) -> Path:
    return system / f"cpu{cpu}" / "power" / "pm_qos_resume_latency_us"
