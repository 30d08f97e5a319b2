"""The property suite of tasks, run unedited over other people's, finds what is wrong."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import bad_tasks
import pytest
from support import HOUSE

SUITE = Path(__file__).with_name("test_task_properties.py")
FAULTS = {
    "Faultless": "",
    "FarOff": "gradient_and_rate_are_the_derivatives",
    "Negative": "v_is_never_negative",
    "Grudger": "repeats_bit_by_bit",
    "Renewer": "arrays_are_laid_out_once",
    "Sharer": "arrays_are_laid_out_once",
    "Jumper": "after_a_reset_nothing_jumps",
    "Reaching": "",
    "Slanted": "jacobian_and_rate_are_the_derivatives_of_its_error",
    "Late": "jacobian_and_rate_are_the_derivatives_of_its_error",
}


@pytest.mark.long
def test_the_suite_finds_each_fault():
    assert all(hasattr(bad_tasks, name) for name in FAULTS)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", str(SUITE), "-q", "-p", "no:cacheprovider"],
        env={**os.environ, "HOAP3_TEST_TASKS": ",".join(f"bad_tasks:{name}" for name in FAULTS)},
        cwd=HOUSE,
        capture_output=True,
        text=True,
        check=False,
    )
    failed = re.findall(r"^FAILED .*::test_(\w+)\[.*bad_tasks:(\w+)", done.stdout, re.MULTILINE)
    assert done.returncode == 1, done.stdout
    assert not {"Faultless", "Reaching"} & {name for _, name in failed}, done.stdout
    for name, fault in FAULTS.items():
        if fault:
            assert any(fault in test for test, whose in failed if whose == name), (name, failed)


@pytest.mark.long
def test_a_file_says_parameters(tmp_path):
    """And a fault that building shows is one as well."""
    file = tmp_path / "mine.yaml"
    file.write_text("task: own_tasks:Sway\nparameters: {fault: rate}\n", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", str(SUITE), "-q", "-p", "no:cacheprovider", "-x"],
        env={**os.environ, "HOAP3_TEST_TASKS": str(file)},
        cwd=HOUSE,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert f"{file}: task.task: " in done.stdout
