"""What all tests share: settings of hypothesis and numpy, kernels, order, and garbage spared."""

from __future__ import annotations

import atexit
import gc
import os
import shutil
import sys
import tempfile

import pytest
from hypothesis import HealthCheck, settings
from support.kernels_first import compile_all, kernel_modules
from support.longest_first import place

os.environ.setdefault("OMP_NUM_THREADS", "1")  # as `hoap3` does; numpy reads it when imported
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # hundreds of commands compile our code once
sys.dont_write_bytecode = False
os.environ["HOAP3_RUNTIME_DIR"] = tempfile.mkdtemp(prefix="hoap3-")  # short: it holds sockets
atexit.register(shutil.rmtree, os.environ["HOAP3_RUNTIME_DIR"], ignore_errors=True)

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


def pytest_configure(config: pytest.Config) -> None:
    """Hand files to workers as they are ordered here, not those with the most tests first."""
    config.option.loadscopereorder = False


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest files, each in one piece."""
    items.sort(key=lambda item: place(item.nodeid))


def pytest_sessionfinish() -> None:
    """Fail where something of ours was imported by its room's bare name, a second copy of it."""
    bare = {"protocol", "robot_emulator", "remote_controller", "tools"} & sys.modules.keys()
    if bare:
        raise pytest.UsageError(f"imported without `hoap3.`: {sorted(bare)}")


def pytest_collection_finish() -> None:
    """Keep the garbage collector from visiting again and again what stays until the end."""
    gc.collect()
    gc.freeze()
