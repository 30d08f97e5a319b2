"""The machine block and the software: what a figure was measured on, and what is installed."""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from collections.abc import Iterable, Mapping
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from hoap3.protocol.errors import NotInstalledError
from hoap3.protocol.runtime.realtime import virtual_machine

GOVERNOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
STACK = (
    *("eclipse-zenoh", "numpy", "numba", "pin", "coal", "daqp", "osqp"),
    *("mcap", "pydantic", "typer"),
)


def versions(more: Iterable[str] = ()) -> dict[str, str]:
    """Versions of this project, of everything that it stands on, and of more packages."""
    found = {"python": platform.python_version()}
    for name in ("hoap3", *STACK, *more):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def machine_block() -> dict[str, object]:
    """Facts of this machine and process that figures depend on."""
    policy = {os.SCHED_OTHER: "other", os.SCHED_FIFO: "fifo", os.SCHED_RR: "rr"}
    return {
        "kernel": platform.release(),
        "preemption": _preemption(),
        "governor": file_text(GOVERNOR) or "unknown",
        "processor": _processor(),
        "cores": os.cpu_count(),
        "affinity": sorted(os.sched_getaffinity(0)),
        "policy": policy.get(os.sched_getscheduler(0), "unknown"),
        "virtual": virtual_machine(),
        "load_1min": round(os.getloadavg()[0], 2),
        "blas_threads": os.environ.get("OMP_NUM_THREADS", "default"),
        "gil_switch_interval_s": sys.getswitchinterval(),
        "versions": versions(),
    }


def _preemption() -> str:
    version = platform.version()
    kinds = ("PREEMPT_RT", "PREEMPT_DYNAMIC", "PREEMPT")
    return next((kind for kind in kinds if kind in version), "none")


def _processor() -> str:
    for line in file_text(Path("/proc/cpuinfo")).splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()


def file_text(path: Path) -> str:
    """What a file says, without white space around it; "" where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


ROOMS = ("protocol", "remote_controller")
"""Rooms whose sources decide an answer."""

SOURCES = ("*.py", "*.msg")
OURS = "source"
NOT_LOGGED = "not in the log"
LONGEST = 40  # characters of a version that a log gives


def software() -> dict[str, str]:
    """Versions of all that decides an answer, and our own sources as `source`, 12 digits."""
    return {**versions(), OURS: source_hash()}


def source_hash() -> str:
    """Hash of the names and texts of our sources, 12 hexadecimal digits."""
    house = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for room in ROOMS:
        for path in sorted(path for kind in SOURCES for path in (house / room).rglob(kind)):
            digest.update(str(path.relative_to(house)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:12]


def differences(logged: Mapping[str, str]) -> dict[str, list[str]]:
    """Versions that are not those of a log, by name: the log's, and the present one.

    Args:
        logged: versions by name, as the log has them. Of what it does not name only our own
            sources are a difference: nobody can tell that they are the same.
    """
    now = software()
    logged = {OURS: NOT_LOGGED, **logged}
    return {
        name: [then[:LONGEST], now[name]]
        for name, then in logged.items()
        if name in now and then != now[name]
    }


def in_words(found: Mapping[str, list[str]]) -> str:
    """What `differences` found, in one line; "" for nothing."""
    if not found:
        return ""
    parts = [_part(name, then, now) for name, (then, now) in found.items()]
    return f"the software is not that of the log ({'; '.join(parts)})"


def _part(name: str, then: str, now: str) -> str:
    if name != OURS:
        return f"{name} {then}, now {now}"
    logged = then if then == NOT_LOGGED else f"hash {then}"
    return f"our own code ({logged}, now hash {now})"


EXTRAS = {
    "metrics": ("prometheus-client",),
    "parquet": ("pyarrow",),
    "report": ("jinja2", "matplotlib"),
    "view": ("websockets",),
}
"""Packages that the extras of this project install."""


def check_extra(name: str) -> None:
    """Refuse what needs an extra before it begins.

    Args:
        name: one of `EXTRAS`.

    Raises:
        NotInstalledError: a package of it is not installed.
    """
    for package in EXTRAS[name]:
        if find_spec(package.replace("-", "_")) is None:
            raise NotInstalledError("package", package, f"'hoap3[{name}]'")
