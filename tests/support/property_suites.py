"""Property suites over other people's work, as they would run them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from support import HOUSE


@dataclass(frozen=True)
class Judged:
    """What a suite found.

    Attributes:
        code: pytest's.
        said: what it printed.
        failed: tests and the cases they failed for.
    """

    code: int
    said: str
    failed: frozenset[tuple[str, str]]

    def faults(self, case: str) -> set[str]:
        """Tests that failed for a case, with or without others."""
        return {test for test, label in self.failed if case in label}


def judge(
    folder: Path, suite: str, cases: Sequence[str], robot: str = "", beside: Path | None = None
) -> Judged:
    """Run a suite in a folder that is none of ours.

    Args:
        folder: where its test file is written.
        suite: its name in `hoap3.testing`.
        cases: what it runs over.
        robot: another than its default.
        beside: a folder in which modules of the cases are found.
    """
    lines = [
        f"from hoap3.testing import {suite}",
        f"class TestTheirs({suite}):",
        f"    cases = {tuple(cases)!r}",
        *([f"    robot = {robot!r}"] if robot else []),
    ]
    (folder / "test_theirs.py").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return run(folder, "test_theirs.py", beside)


def run(folder: Path, file: str, beside: Path | None = None) -> Judged:
    """Run a test file in a folder that is none of ours."""
    paths = [str(HOUSE), *([str(beside)] if beside else [])]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", file],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    failed = re.findall(r"^(?:FAILED|ERROR) .*::test_(\w+)\[([^\]]*)\]", done.stdout, re.MULTILINE)
    return Judged(done.returncode, done.stdout + done.stderr, frozenset(failed))
