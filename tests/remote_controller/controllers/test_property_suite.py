"""The property suite, run unedited over other people's controllers, finds what is wrong."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import bad_controllers
import pytest
from support import HOUSE

SUITE = Path(__file__).with_name("test_controller_properties.py")
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
def test_the_suite_finds_the_fault(name):
    assert hasattr(bad_controllers, name)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", str(SUITE), "-q", "-p", "no:cacheprovider"],
        env={**os.environ, "HOAP3_TEST_CONTROLLERS": f"bad_controllers:{name}, qp12"},
        cwd=HOUSE,
        capture_output=True,
        text=True,
        check=False,
    )
    failed = re.findall(rf"^FAILED .*::test_(\w+)\[.*{name}", done.stdout, re.MULTILINE)
    assert done.returncode == (1 if FAULTS[name] else 0), done.stdout
    for fault in FAULTS[name]:
        assert any(fault in test for test in failed), (fault, failed)
