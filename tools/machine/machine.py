"""The machine block: what a figure was measured on, printed with every report."""

from __future__ import annotations

import os
import platform
import sys
from importlib import metadata
from pathlib import Path

from hoap3.protocol.runtime.realtime import virtual_machine

STACK = (
    *("eclipse-zenoh", "numpy", "numba", "pin", "coal", "daqp", "osqp"),
    *("mcap", "pydantic", "typer"),
)


def versions() -> dict[str, str]:
    """Versions of this project and of everything that it stands on."""
    found = {"python": platform.python_version()}
    for name in ("hoap3", *STACK):
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
        "governor": _line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
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
    for line in _text("/proc/cpuinfo").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()


def _line(path: str) -> str:
    return _text(path).strip() or "unknown"


def _text(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
