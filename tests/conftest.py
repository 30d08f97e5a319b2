"""What all tests share: settings of hypothesis and numpy, kernels, and garbage spared."""

from __future__ import annotations

import gc
import os

import pytest
from hypothesis import HealthCheck, settings
from kernels_first import compile_all, kernel_modules

os.environ.setdefault("OMP_NUM_THREADS", "1")  # as `hoap3` does; numpy reads it when imported

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
    compile_all(kernel_modules())


def pytest_collection_finish() -> None:
    """Keep the garbage collector from visiting again and again what stays until the end."""
    gc.collect()
    gc.freeze()
