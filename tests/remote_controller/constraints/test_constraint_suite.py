"""The property suite of constraints, run over other people's, finds what is wrong."""

from __future__ import annotations

from pathlib import Path

import bad_constraints
import pytest
from support.property_suites import judge

HERE = Path(__file__).parent
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


@pytest.mark.long
def test_the_suite_finds_each_fault(tmp_path):
    assert all(hasattr(bad_constraints, name) for name in FAULTS)
    cases = [f"bad_constraints:{name}" for name in FAULTS]
    found = judge(tmp_path, "ConstraintProperties", cases, beside=HERE)
    assert found.code == 1, found.said
    for name, fault in FAULTS.items():
        failed = found.faults(f"bad_constraints:{name}")
        assert any(fault in test for test in failed) if fault else not failed, (name, failed)


@pytest.mark.long
def test_a_file_says_parameters(tmp_path):
    file = tmp_path / "mine.yaml"
    content = "constraint: bad_constraints:Faultless\nparameters: {eta_per_s: 1001}\n"
    file.write_text(content, encoding="utf-8")
    found = judge(tmp_path, "ConstraintProperties", [str(file)], beside=HERE)
    assert found.code == 1
    assert f"{file}: parameters.constraints.0.parameters.eta_per_s: " in found.said
