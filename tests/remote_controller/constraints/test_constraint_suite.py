"""The property suite of constraints, run unedited over other people's, finds what is wrong."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import bad_constraints
import pytest
from support import HOUSE

SUITE = Path(__file__).with_name("test_constraint_properties.py")
FAULTS = {
    "Faultless": "",
    "Backward": "rows_allow_keeps_equation_25",
    "Hasty": "rows_allow_keeps_equation_25",
    "Grudger": "repeats_bit_by_bit",
    "Adder": "writes_all_of_its_arrays",
    "Forbidder": "rows_that_are_not_needed",
    "Widener": "bounds_narrow_what_they_are_given",
    "Renewer": "arrays_are_laid_out_once",
    "Meddler": "writes_all_of_its_arrays_and_no_other",
}


def suite(named: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "pytest", str(SUITE), "-q", "-p", "no:cacheprovider"],
        env={**os.environ, "HOAP3_TEST_CONSTRAINTS": named},
        cwd=HOUSE,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.long
def test_the_suite_finds_each_fault():
    assert all(hasattr(bad_constraints, name) for name in FAULTS)
    done = suite(",".join(f"bad_constraints:{name}" for name in FAULTS))
    found = r"^FAILED .*::test_(\w+)\[.*bad_constraints:(\w+)"
    failed = re.findall(found, done.stdout, re.MULTILINE)
    assert done.returncode == 1, done.stdout
    assert "Faultless" not in {name for _, name in failed}, done.stdout
    for name, fault in FAULTS.items():
        if fault:
            assert any(fault in test for test, whose in failed if whose == name), (name, failed)


@pytest.mark.long
def test_a_file_says_parameters(tmp_path):
    file = tmp_path / "mine.yaml"
    content = "constraint: bad_constraints:Faultless\nparameters: {eta_per_s: 1001}\n"
    file.write_text(content, encoding="utf-8")
    done = suite(str(file))
    assert done.returncode == 1
    assert f"{file}: parameters.constraints.0.parameters.eta_per_s: η·T" in done.stdout
