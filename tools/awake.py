"""A CPU that spins when it is idle, instead of falling asleep.

What runs after a sleep finds its caches cold, and on a virtual machine the host may have lent the
CPU to others meanwhile: the same tick takes three times as long.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

SYSTEM = Path("/sys/devices/system/cpu")
NO_LATENCY = "n/a"  # the kernel's word for: not even the shortest sleep


def may_keep_awake(system: Path = SYSTEM) -> bool:
    """Whether every CPU that we may run on can be kept awake."""
    return all(os.access(_setting(cpu, system), os.W_OK) for cpu in os.sched_getaffinity(0))


@contextmanager
def kept_awake(cpu: int, system: Path = SYSTEM) -> Iterator[str]:
    """Keep a CPU awake; what was set before is set again at the end.

    Where somebody else keeps it awake already, it is left to them.

    Yields:
        "" or why it was refused.
    """
    setting = _setting(cpu, system)
    try:
        before = setting.read_text(encoding="ascii").strip()
        setting.write_text(NO_LATENCY, encoding="ascii")
    except OSError as error:
        yield f"{error.strerror or error}; it takes root, or the right to write {setting}"
        return
    try:
        yield ""
    finally:
        if before != NO_LATENCY:
            setting.write_text(before, encoding="ascii")


def _setting(cpu: int, system: Path) -> Path:
    return system / f"cpu{cpu}" / "power" / "pm_qos_resume_latency_us"
