"""The property suite, run over other people's controllers, finds what is wrong."""

from __future__ import annotations

from pathlib import Path

import bad_controllers
import pytest
from support.property_suites import judge

FAULTS = {
    "Faultless": set(),
    "Hasty": {"obeys_the_limits", "starts_anywhere_without_a_jump"},
    "Jumper": {"starts_anywhere_without_a_jump"},
    "Restless": {"another_takes_over_without_a_jump"},
    "Gambler": {"two_runs_give_the_same_bytes", "answers_follow_from_reset_and_states"},
    "Clockwatcher": {"answers_follow_from_reset_and_states"},
    "Grudger": {"answers_follow_from_reset_and_states"},
    "Liar": {"prediction_of_v_is_the_derivative"},
    "Sluggard": {"certificates_hold"},
    "Hoarder": {"keeps_nothing_of_what_it_allocates"},
    "Latecomer": {"leaves_nothing_to_compile_or_import"},
    "Meddler": {"writes_into_its_own_command_only"},
    "Sharer": {"writes_into_its_own_command_only"},
    "Numberer": {"order_of_joints_on_the_wire"},
}


@pytest.mark.long
@pytest.mark.parametrize("name", FAULTS)
def test_the_suite_finds_the_fault(name, tmp_path):
    assert hasattr(bad_controllers, name)
    cases = (f"bad_controllers:{name}", "qp12")
    found = judge(tmp_path, "ControllerProperties", cases, beside=Path(__file__).parent)
    assert found.code == (1 if FAULTS[name] else 0), found.said
    failed = found.faults(name)
    for fault in FAULTS[name]:
        assert any(fault in test for test in failed), (fault, failed)
