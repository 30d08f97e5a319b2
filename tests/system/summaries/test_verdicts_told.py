"""A default run is good in all three verdicts; one that misses its target and falls is not."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.command_bench import inside

from hoap3.protocol.runtime.recorder import MemoryRecorder, NoRecorder
from hoap3.tools.services.run_statistics import RunStatistics
from hoap3.tools.show.certificate_count import in_a_line
from hoap3.tools.simulate import Lockstep, controller_settings, emulator_settings

GOOD = {"deadlines": "pass", "task": "pass", "limits_and_balance": "pass"}
FAR = ("--controller", "qp12", "--set", "controller.parameters.target_m=[9,9,9]")


def test_a_default_run_passes_all_three(tmp_path: Path) -> None:
    done = inside("run", "--lockstep", "--json", "--out", tmp_path / "log")
    summary = done.json()
    assert summary["verdicts"] == GOOD
    assert done.code == 0
    report = inside("report", tmp_path / "log", "--json")
    assert report.code == 0
    for key in ("verdicts", "task", "limits_and_balance"):
        assert report.json()[key] == summary[key]
    page = (tmp_path / "log" / "report.html").read_text(encoding="utf-8")
    assert re.findall(r'class="badge (\w+)"', page) == ["pass", "pass", "pass"]


@pytest.mark.slow
def test_an_unreachable_target_is_no_success(tmp_path: Path) -> None:
    words = ("run", "--lockstep", "--duration", "2", *FAR)
    done = inside(*words, "--out", tmp_path / "log")
    assert done.code == 1
    assert re.search(r"^deadlines +pass", done.stdout, re.MULTILINE)
    assert re.search(r"^task +fail: error above tolerance", done.stdout, re.MULTILINE)
    assert re.search(r"^limits and balance +fail: .*left the support", done.stdout, re.MULTILINE)
    told = inside("report", tmp_path / "log", "--json")
    assert told.code == 1
    verdicts = told.json()["verdicts"]
    assert verdicts == {"deadlines": "pass", "task": "fail", "limits_and_balance": "fail"}
    without_log = inside(*words, "--json", "--set", "emulator.log.record=false").json()
    assert without_log["verdicts"] == verdicts


def test_the_robot_alone_says_what_the_wire_tells() -> None:
    speed = {"speed": 9, "joints": {"l_shoulder_pitch": 1.0}, "tolerance": 0.9}
    constraints = [
        {"constraint": "joint_velocity"},
        {"constraint": "minimum_speed", "parameters": speed},
    ]
    content = {"controller": "stable_qp", "parameters": {"constraints": constraints}}
    log = MemoryRecorder()
    sides = emulator_settings("hoap3", 0), controller_settings(content)
    Lockstep(*sides, log, NoRecorder()).run(0.05)
    statistics = RunStatistics(1_000_000, timing=False)
    for record in log.records:
        statistics.add(record)
    summary = statistics.summary()
    assert summary["verdicts"] == {**GOOD, "task": "not judged", "limits_and_balance": "not judged"}
    assert summary["task"]["reasons"] == ["not_told_by_controller"]
    (reasons,) = summary["certificates"]["reasons"].values()
    assert reasons == {"the reason is in the controller's log": 50}
    assert "50 infeasible: the reason is in the controller's log" in in_a_line(
        summary["certificates"]
    )
