"""A CPU that spins when it is idle, instead of falling asleep.

What runs after a sleep finds its caches cold, and on a virtual machine the host may have lent the
CPU to others meanwhile: the same tick takes three times as long.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

SYSTEM = Path("/sys/devices/system/cpu")
NO_LATENCY = "n/a"  # the kernel's word for: not even the shortest sleep


@contextmanager
def kept_awake(cpu: int, system: Path = SYSTEM) -> Iterator[str]:
    """Keep a CPU awake; what was set before is set again at the end.

    Where somebody else keeps it awake already, it is left to them.

    Yields:
        "" or why it was refused.
    """
    setting = system / f"cpu{cpu}" / "power" / "pm_qos_resume_latency_us"
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
