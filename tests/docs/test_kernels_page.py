"""docs/kernels.md has every file with kernels, and what it names exists and is as it says."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from pages import HOUSE, table
from test_papers import functions

ROOMS = ("protocol", "robot_emulator", "remote_controller", "tools")
FAMILIES = table("kernels.md", "Kernels and their references")


def named(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


def test_every_file_with_kernels_is_in_one_family():
    files = [path for room in ROOMS for path in (HOUSE / room).rglob("*_kernels.py")]
    compiled = {
        str(path.relative_to(HOUSE))
        for path in files
        if re.search(r"^@(kernel|inlined)|= inlined\(", path.read_text(encoding="utf-8"), re.M)
    }
    listed = [file for family in FAMILIES for file in named(family["kernels"])]
    assert sorted(listed) == sorted(compiled)


@pytest.mark.parametrize("family", FAMILIES, ids=[family["family"] for family in FAMILIES])
def test_each_has_a_reference_and_a_test_of_five_thousand_problems(family):
    assert family["equations"]
    assert int(family["problems"].replace(",", "")) >= 5000
    for reference in named(family["reference"]):
        assert (HOUSE / reference).is_file()
    tests = named(family["test"])
    assert tests
    for place in tests:
        path, _, name = place.partition("::")
        assert name in functions(path)
        assert "slow" in (HOUSE / path).read_text(encoding="utf-8")


def test_references_run_without_numba():
    files = {file for family in FAMILIES for file in named(family["reference"])}
    modules = [f"hoap3.{file.removesuffix('.py').replace('/', '.')}" for file in sorted(files)]
    probe = f"import {', '.join(modules)}, sys; assert 'numba' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", probe], check=False, capture_output=True)
    assert done.returncode == 0, done.stderr.decode()
