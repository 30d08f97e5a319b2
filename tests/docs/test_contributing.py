"""The example patches of CONTRIBUTING.md apply, and what they add is tested at once."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support import HOUSE

ROOMS = "protocol", "remote_controller", "robot_emulator", "tools", "hoap3"
BESIDE = "benchmarks", "tests", "docs"
TESTS = "tests/remote_controller"
TASK, CONSTRAINT = "new_task.diff", "new_constraint.diff"


def patch(name: str) -> str:
    """The patch that adds a task, or a constraint."""
    return (Path(__file__).parent / "patches" / name).read_text(encoding="utf-8")


@pytest.fixture
def run(tmp_path):
    """Run a command in a copy of the checkout; what it says."""
    copy = tmp_path / "checkout"
    copy.mkdir()
    ignore = shutil.ignore_patterns("__pycache__")
    for room in (*ROOMS, *BESIDE):
        shutil.copytree(HOUSE / room, copy / room, symlinks=True, ignore=ignore)
    shutil.copy(HOUSE / "pyproject.toml", copy)

    def told(*command: str, text: str | None = None) -> str:
        said = {"capture_output": True, "text": True}
        done = subprocess.run(command, cwd=copy, input=text, check=False, **said)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return told


PYTEST = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-rA")


@pytest.mark.long
def test_a_new_task_is_tested_from_the_start(run):
    """Every suite of tasks tries it, and passes; kernels are compiled anew in the copy."""
    run("git", "apply", "-C1", text=patch(TASK))
    run(sys.executable, "-m", "benchmarks.tables.tasks_table")
    words = "joint_pair or two and joints or is_tried or up_to_date or beside_each_other"
    told = run(*PYTEST, f"{TESTS}/tasks", "-k", words)
    for suite in ("task_properties", "task_derivatives", "task_rows", "task_levels"):
        name = "joint_pair" if suite == "task_levels" else "two joints"
        assert re.search(rf"PASSED .*test_{suite}\.py::.*{name}", told), told


@pytest.mark.long
def test_a_new_constraint_is_tested_from_the_start(run):
    """Every suite of constraints tries it, and passes."""
    run("git", "apply", "-C1", text=patch(CONSTRAINT))
    run(sys.executable, "-m", "benchmarks.tables.constraints_table")
    told = run(*PYTEST, f"{TESTS}/constraints", "-k", "least_height or up_to_date")
    for suite in ("constraint_properties", "viable_steps", "constraint_levels"):
        assert re.search(rf"PASSED .*test_{suite}\.py::.*least_height", told), told
