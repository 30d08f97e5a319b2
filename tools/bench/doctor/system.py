"""What the doctor looks at: a machine whose files, limits and calls can be replaced by others."""

from __future__ import annotations

import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from hoap3.protocol.runtime.clock import Clock, MonotonicClock
from hoap3.tools.machine.machine import file_text

Level = Literal["ok", "advice", "problem"]

_BLOCK = bytes(64 * 1024)


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        name: what.
        level: ok; advice: the loop runs, but would run better; problem: it cannot be relied on.
        found: what there is.
        remedy: what to do about it; "" where there is nothing to do.
    """

    name: str
    level: Level
    found: str
    remedy: str = ""


def fifo(priority: int) -> str | None:
    """Try SCHED_FIFO in a process of its own; None where it is granted, else why not."""
    code = (
        "import os, sys\n"
        "try:\n"
        "    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(sys.argv[1])))\n"
        "except OSError as error:\n"
        "    sys.exit(error.strerror)\n"
    )
    command = [sys.executable, "-I", "-S", "-c", code, str(priority)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    return None if done.returncode == 0 else done.stderr.strip() or "refused"


def free(folder: Path) -> int:
    """Bytes that may still be written there.

    Raises:
        OSError: it cannot be asked.
    """
    return shutil.disk_usage(folder).free


def write_speed(folder: Path, seconds: float = 0.4, patience: float = 0.9) -> float:
    """Bytes per second of small synced writes; 0 where not one of them ends in time.

    Args:
        folder: where a file without a name is written.
        seconds: after which no further write is begun.
        patience: after which the one at hand is not waited for [s].

    Raises:
        OSError: it cannot be written.
    """
    speed: list[float] = []
    failure: list[OSError] = []

    def write() -> None:
        try:
            with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
                start = now = time.monotonic()
                while now - start < seconds:
                    file.write(_BLOCK)
                    os.fsync(file.fileno())
                    now = time.monotonic()
                    speed.append(file.tell() / max(now - start, 1e-9))
        except OSError as error:
            failure.append(error)

    thread = threading.Thread(target=write, daemon=True)  # a disk that hangs cannot be told to stop
    thread.start()
    thread.join(patience)
    if failure:
        raise failure[0]
    return speed[-1] if speed else 0.0


def kernel_cache() -> tuple[Path | None, bool]:
    """Where compiled kernels are kept, and whether they outlive the process."""
    from hoap3.protocol.runtime.numba_jit import CACHE_DIRECTORY, fingerprint

    kept = CACHE_DIRECTORY is not None and CACHE_DIRECTORY.name == f"kernels-{fingerprint()}"
    return CACHE_DIRECTORY, kept


@dataclass(frozen=True)
class System:
    """A machine, as far as the doctor looks at it.

    Attributes:
        root: folder below which `/proc` and `/sys` lie.
        logs: folder that logs go to; it need not exist.
        limit: soft and hard limit of a resource.
        fifo: tries a priority; None where it is granted, else why not.
        kernel_cache: where compiled kernels are kept, and whether they outlive the process.
        free, write_speed: bytes, and bytes per second, of a folder.
        clock: for whatever is timed.
    """

    root: Path = Path("/")
    logs: Path = Path("logs")
    limit: Callable[[int], tuple[int, int]] = resource.getrlimit
    fifo: Callable[[int], str | None] = fifo
    kernel_cache: Callable[[], tuple[Path | None, bool]] = kernel_cache
    free: Callable[[Path], int] = free
    write_speed: Callable[[Path], float] = write_speed
    clock: Clock = field(default_factory=MonotonicClock)

    def text(self, path: str) -> str:
        """What a file says, without white space around it; "" where it cannot be read."""
        return file_text(self.root / path)

    def number(self, path: str) -> int | None:
        """The integer that a file begins with, or None."""
        try:
            return int(self.text(path).split()[0])
        except (IndexError, ValueError):
            return None

    def paths(self, pattern: str) -> list[str]:
        """Files that match, relative to the root; numbers in names are ordered as numbers."""
        found = [str(path.relative_to(self.root)) for path in self.root.glob(pattern)]
        return sorted(found, key=lambda path: (len(path), path))

    def capable(self, capability: int) -> bool:
        """Whether this process has a capability, by its number."""
        found = re.search(r"^CapEff:\s*([0-9a-f]+)$", self.text("proc/self/status"), re.MULTILINE)
        return found is not None and bool(int(found[1], 16) >> capability & 1)

    def virtual(self) -> str:
        """The hypervisor below, as far as it shows; "" on bare metal."""
        product = self.text("sys/class/dmi/id/product_name")
        kind = self.text("sys/hypervisor/type")
        if " hypervisor" not in self.text("proc/cpuinfo") and not kind:
            return ""
        return kind or product or "unnamed"
