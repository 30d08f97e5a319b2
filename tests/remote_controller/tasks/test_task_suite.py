"""The property suite of tasks, run over other people's, finds what is wrong."""

from __future__ import annotations

from pathlib import Path

import bad_tasks
import pytest
from support.property_suites import judge

HERE = Path(__file__).parent
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
def test_the_suite_finds_each_fault(tmp_path):
    assert all(hasattr(bad_tasks, name) for name in FAULTS)
    cases = [f"bad_tasks:{name}" for name in FAULTS]
    found = judge(tmp_path, "TaskProperties", cases, beside=HERE)
    assert found.code == 1, found.said
    for name, fault in FAULTS.items():
        failed = found.faults(f"bad_tasks:{name}")
        assert any(fault in test for test in failed) if fault else not failed, (name, failed)


@pytest.mark.long
def test_a_file_says_parameters(tmp_path):
    """And a fault that building shows is one as well."""
    file = tmp_path / "mine.yaml"
    file.write_text("task: own_tasks:Sway\nparameters: {fault: rate}\n", encoding="utf-8")
    found = judge(tmp_path, "TaskProperties", [str(file)], beside=HERE)
    assert found.code == 1
    assert f"{file}: task.task: " in found.said
