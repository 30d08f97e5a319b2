"""A robot that held joints back says so, at the end of a run and in its report."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.command_bench import Done, assert_ran, inside

pytestmark = pytest.mark.slow

HASTY = ("--controller", "pinv")  # knows no limits, and HOAP-3's waist starts at its own


def lockstep(*arguments: object) -> Done:
    done = inside("run", "--lockstep", "--duration", 0.4, *arguments)
    assert_ran(done)
    return done


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("hasty") / "run"


def test_they_are_counted_told_and_not_certified(folder: Path) -> None:
    told = lockstep(*HASTY, "--out", folder).stdout
    counts = lockstep(*HASTY, "--json", "--set", "emulator.log.record=false").json()
    held_back = counts["interventions"]
    assert held_back > 0
    assert re.search(rf"interventions +a joint was held back in {held_back} periods", told)
    assert counts["verdicts"]["limits_and_balance"] == "fail"
    assert counts["limits_and_balance"]["reasons"] == ["held_back"]
    joints = counts["limits_and_balance"]["held_back_joints"]
    assert 0 < joints["most_periods"] <= held_back
    assert f"first {joints['first']} at tick" in told
    assert counts["certificates"]["uncertified"] >= held_back - 1  # the stop at the end has none
    report = inside("report", folder, "--json").json()
    assert report["interventions"] == held_back
    assert report["limits_and_balance"]["held_back_joints"] == joints
    assert f"held joints back in {held_back} periods" in " ".join(report["gaps"])


def test_without_any_nothing_is_said(tmp_path: Path) -> None:
    done = lockstep("--out", tmp_path / "run", "--json")
    assert done.json()["interventions"] == 0
    assert "interventions" not in lockstep("--out", tmp_path / "again").stdout
