"""CONTRIBUTING.md: its patch applies, and what it adds is tested without further places."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys

import pytest
from support import HOUSE

ROOMS = ("protocol", "remote_controller", "robot_emulator", "tools", "tests", "docs", "hoap3")
TESTS = "tests/remote_controller/tasks"


def patch() -> str:
    """The patch that adds a task."""
    text = (HOUSE / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (found,) = re.findall(r"^```diff\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)
    return found


def test_a_new_task_touches_three_places():
    assert len(re.findall(r"^\+\+\+ ", patch(), flags=re.MULTILINE)) == 3


@pytest.mark.long
def test_a_new_task_is_tested_from_the_start(tmp_path):
    """Every suite of tasks tries it, and passes; kernels are compiled anew in the copy."""
    copy = tmp_path / "checkout"
    copy.mkdir()
    for room in ROOMS:
        shutil.copytree(
            HOUSE / room, copy / room, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
        )
    shutil.copy(HOUSE / "pyproject.toml", copy)

    def run(*command: str, text: str | None = None) -> str:
        done = subprocess.run(
            command, cwd=copy, input=text, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    run("git", "apply", "-C1", text=patch())
    run(sys.executable, "-m", "hoap3.tools.robots.tasks_table")
    words = "joint_pair or two and joints or is_tried or up_to_date or beside_each_other"
    pytest_ = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-rA", TESTS)
    told = run(*pytest_, "-k", words)
    for suite in ("task_properties", "task_derivatives", "task_rows", "task_levels"):
        name = "joint_pair" if suite == "task_levels" else "two joints"
        assert re.search(rf"PASSED .*test_{suite}\.py::.*{name}", told), told
