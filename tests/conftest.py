"""Settings that every test shares: hypothesis without deadlines, reproducible where CI says so."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("local", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile(
    "ci",
    parent=settings.get_profile("local"),
    derandomize=True,
    print_blob=True,
)
settings.load_profile("ci" if os.environ.get("CI") else "local")


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile all kernels once, before several workers do it at the same time."""
    if getattr(session.config.option, "dist", "no") == "no" or hasattr(
        session.config, "workerinput"
    ):
        return
    house = Path(__file__).parent.parent
    kernels = sorted(
        ".".join(path.relative_to(house).with_suffix("").parts)
        for room in ("protocol", "remote_controller", "robot_emulator")
        for path in (house / room).rglob("*_kernels.py")
    )
    halves = [f"import {', '.join(kernels[start::2])}" for start in range(2)]
    compilers = [subprocess.Popen([sys.executable, "-c", half], cwd=house) for half in halves]
    if sum(compiler.wait() for compiler in compilers):  # both, whatever the first one says
        pytest.exit("kernels do not compile", 1)
