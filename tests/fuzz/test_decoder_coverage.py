"""Fuzzers and tests of the decoders take every branch of them, as `coverage` counts."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from support import HOUSE

DECODERS = (
    "protocol/messages.py",
    "protocol/link/hoap3_tcp/frames.py",
    "robot_emulator/setpoint_validator.py",
    "remote_controller/steering.py",
)
TESTS = (
    "fuzz/test_fuzz_messages.py",
    "fuzz/test_fuzz_hoap3_tcp.py",
    "protocol/test_message_layout.py",
    "protocol/test_golden_messages.py",
    "protocol/link/hoap3_tcp/test_hoap3_frames.py",
    "remote_controller/test_steering.py",
    "robot_emulator/test_acting_ahead.py",
    "robot_emulator/test_conflicting_setpoints.py",
    "robot_emulator/test_deadline_rules.py",
    "robot_emulator/test_words.py",
)


@pytest.mark.long
def test_every_branch_of_the_decoders_is_taken(tmp_path: Path) -> None:
    environment = {
        **os.environ,
        "COVERAGE_FILE": str(tmp_path / "coverage"),
        "PYTHONPATH": str(HOUSE),
    }

    def run(*words: str) -> None:
        command = [sys.executable, "-m", "coverage", *words]
        subprocess.run(command, cwd=HOUSE, env=environment, check=True)

    files = [f"tests/{name}" for name in TESTS]
    run("run", "--branch", "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not long", *files)
    run("combine", "--quiet")
    told = tmp_path / "coverage.json"
    run("json", "--quiet", "-o", str(told), "--include", ",".join(DECODERS))
    files_told = json.loads(told.read_text(encoding="utf-8"))["files"]
    missed = {
        name: (found["missing_lines"], found["missing_branches"])
        for name, found in files_told.items()
        if found["missing_lines"] or found["missing_branches"]
    }
    print({name: found["summary"]["num_branches"] for name, found in files_told.items()})
    assert sorted(files_told) == sorted(DECODERS)
    assert not missed
