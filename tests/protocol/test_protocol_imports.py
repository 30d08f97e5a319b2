"""What each module of the protocol loads, and that it loads nothing heavy unasked."""

from __future__ import annotations

import subprocess
import sys

import pytest
from support import HOUSE

HEAVY = {"numba", "pinocchio", "zenoh"}
LIGHT_MODULES = (
    "errors",
    "messages",
    "config.settings",
    "link.base",
    "robot.description",
    "robot.pinocchio_model",
    "runtime.clock",
    "runtime.deadlines",
    "runtime.realtime",
    "runtime.recorder",
    "runtime.shm_ring",
)
ALLOWED = {
    **{name: set() for name in LIGHT_MODULES},
    "link.zenoh_session": {"zenoh"},
}


def loaded_by(statement: str) -> set[str]:
    """Names of all modules after a statement in a fresh interpreter."""
    done = subprocess.run(
        [sys.executable, "-c", f"{statement}; import sys; print(*sys.modules)"],
        capture_output=True,
        check=True,
        cwd=HOUSE,
        text=True,
    )
    return set(done.stdout.split())


def test_the_package_itself_loads_nothing():
    loaded = loaded_by("import hoap3.protocol")
    assert not loaded & {*HEAVY, "numpy", "pydantic", "yaml"}
    ours = {name for name in loaded if name.startswith("hoap3.protocol.")}
    assert ours == {"hoap3.protocol.errors"}


@pytest.mark.parametrize("module", ALLOWED)
def test_a_module_loads_what_it_may_and_no_other_room(module):
    loaded = loaded_by(f"import hoap3.protocol.{module}")
    assert f"hoap3.protocol.{module}" in loaded
    assert loaded & HEAVY == ALLOWED[module]
    rooms = {"tools", "robot_emulator", "remote_controller"}
    assert not loaded & {f"hoap3.{room}" for room in rooms}


def test_messages_need_nothing_but_numpy():
    loaded = loaded_by("import hoap3.protocol.messages")
    ours = {name for name in loaded if name.startswith("hoap3.protocol.")}
    assert ours == {"hoap3.protocol.messages", "hoap3.protocol.errors"} | {
        name for name in ours if name.startswith("hoap3.protocol.msg")
    }
    assert not loaded & {"pydantic", "yaml"}
