"""What a run and its report tell: verdicts, certificates, interventions, failed tasks."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from support.command_bench import (
    Done,
    assert_ran,
    endpoint,
    followed,
    hoap3,
    inside,
    wait_for_mode,
)

from hoap3.protocol.runtime.recorder import MemoryRecorder, NoRecorder
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.verdicts import judge_run
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.run_statistics import RunStatistics
from hoap3.tools.services.simulate import Lockstep
from hoap3.tools.verify.verify import verify

GOOD = {"deadlines": "pass", "task": "pass", "limits_and_balance": "pass"}
FAR = ("--controller", "qp12", "--set", "controller.parameters.target_m=[9,9,9]")


@pytest.mark.slow
def test_a_default_run_passes_all_three(tmp_path):
    done = inside("run", "--lockstep", "--json", "--out", tmp_path / "log")
    summary = done.json()
    assert summary["verdicts"] == GOOD
    assert summary["interventions"] == 0
    assert done.code == 0
    report = inside("report", tmp_path / "log", "--json")
    assert report.code == 0
    for key in ("verdicts", "task", "limits_and_balance"):
        assert report.json()[key] == summary[key]
    page = (tmp_path / "log" / "report.html").read_text(encoding="utf-8")
    assert re.findall(r'class="badge (\w+)"', page) == ["pass", "pass", "pass"]


@pytest.mark.slow
def test_an_unreachable_target_is_no_success(tmp_path):
    words = ("run", "--lockstep", "--duration", "2", *FAR)
    done = inside(*words, "--out", tmp_path / "log")
    assert done.code == 1
    assert re.search(r"^deadlines +pass", done.stdout, re.MULTILINE)
    assert re.search(r"^task +fail", done.stdout, re.MULTILINE)
    assert re.search(r"^limits and balance +fail", done.stdout, re.MULTILINE)
    told = inside("report", tmp_path / "log", "--json")
    assert told.code == 1
    verdicts = told.json()["verdicts"]
    assert verdicts == {"deadlines": "pass", "task": "fail", "limits_and_balance": "fail"}
    without_log = inside(*words, "--json", "--set", "emulator.log.record=false").json()
    assert without_log["verdicts"] == verdicts


def test_the_robot_alone_says_what_the_wire_tells():
    speed = {"speed": 9, "joints": {"l_shoulder_pitch": 1.0}, "tolerance": 0.9}
    fast = {"constraint": "minimum_speed", "parameters": speed}
    constraints = [{"constraint": "joint_velocity"}, fast]
    content = {"controller": "stable_qp", "parameters": {"constraints": constraints}}
    log = MemoryRecorder()
    sides = load_emulator_config("hoap3", seed=0)[0], load_controller_config(content)[0]
    Lockstep(*sides, log, NoRecorder()).run(0.05)
    statistics = RunStatistics(1_000_000, timing=False)
    for record in log.records:
        statistics.add(record)
    summary = statistics.figures()
    summary |= judge_run(summary, statistics.counts, None)
    assert summary["verdicts"] == {**GOOD, "task": "not judged", "limits_and_balance": "not judged"}
    assert summary["task"]["reasons"] == ["not_told_by_controller"]
    (reasons,) = summary["certificates"]["reasons"].values()
    assert reasons == {"the reason is in the controller's log": 50}


FAST = "minimum_speed, parameters: {speed: 9, joints: {l_shoulder_pitch: 1.0}, tolerance: 0.9}"
CONTRADICTORY = (
    *("--controller", "stable_qp", "--set"),
    f"controller.parameters.constraints=[{{constraint: joint_velocity}}, {{constraint: {FAST}}}]",
)


def lockstep(*arguments: object) -> Done:
    return inside("run", "--lockstep", "--duration", 0.2, *arguments)


@pytest.mark.slow
def test_answers_that_prove_nothing_are_counted_by_their_reasons(tmp_path):
    run = lockstep(*CONTRADICTORY, "--out", tmp_path / "run", "--json")
    assert run.code == 1
    verdicts = run.json()["verdicts"]
    assert (verdicts["deadlines"], verdicts["task"]) == ("pass", "fail")
    counted = run.json()["certificates"]
    assert counted["reasons"]["infeasible"]["infeasible_constraints"] == counted["n"] == 200
    told = inside("report", tmp_path / "run", "--json")
    assert told.code == 1
    assert {name: told.json()["certificates"][name] for name in counted} == counted
    again = lockstep(*CONTRADICTORY, "--json", "--set", "emulator.log.record=false")
    assert again.json()["certificates"] == counted


@pytest.mark.slow
def test_certificates_that_are_worth_little_are_told_though_every_answer_has_one(tmp_path):
    flat = (f"controller.parameters.tasks.{place}.weight=1" for place in range(3))
    weights = [word for each in flat for word in ("--set", each)]
    slow = (*("--robot", "hoap3", "--controller", "clik_sdp_hoap3"), *weights)
    words = "beta below a tenth of what was asked"
    assert_ran(lockstep(*slow, "--out", tmp_path / "run"))
    found = inside("report", tmp_path / "run", "--json").json()
    assert found["certificates"]["reasons"] == {"certified": {words: 100}}
    (condition,) = (each for each in found["conditions"] if each["condition"] == words)
    assert (condition["ticks"], condition["longest"], condition["times"]) == (100, 100, 1)
    again = lockstep(*slow, "--json", "--set", "emulator.log.record=false").json()
    assert again["certificates"]["reasons"] == {"certified": {words: 100}}
    with_weights = lockstep(*slow[:4], "--out", tmp_path / "other", "--json").json()
    assert not with_weights["certificates"]["reasons"]


@pytest.mark.slow
def test_in_real_time_it_is_told_as_well(tmp_path):
    folder = tmp_path / "run"
    command = hoap3("run", "--duration", 1.0, *CONTRADICTORY, "--out", folder, "--json")
    assert command.end() in {0, 1}, command.stderr  # how fit this machine is, is another matter
    counted = command.json()["certificates"]
    assert counted["infeasible"] == counted["n"] > 0
    assert set(counted["reasons"]["infeasible"]) >= {"infeasible_constraints"}
    figures = inside("report", folder, "--json").json()["certificates"]
    assert {name: figures[name] for name in counted} == counted


HASTY = ("--controller", "pinv")  # knows no limits, and HOAP-3's waist starts at its own


@pytest.mark.slow
def test_interventions_are_counted_and_not_certified(tmp_path):
    hasty = ("run", "--lockstep", "--duration", 0.4, *HASTY)  # beyond the first 200 ticks
    assert_ran(inside(*hasty, "--out", tmp_path / "run"))
    counts = inside(*hasty, "--json", "--set", "emulator.log.record=false").json()
    held_back = counts["interventions"]
    assert held_back > 0
    assert counts["verdicts"]["limits_and_balance"] == "fail"
    assert counts["limits_and_balance"]["reasons"] == ["held_back"]
    joints = counts["limits_and_balance"]["held_back_joints"]
    assert 0 < joints["most_periods"] <= held_back
    assert counts["certificates"]["uncertified"] >= held_back - 1  # the stop at the end has none
    report = inside("report", tmp_path / "run", "--json").json()
    assert report["interventions"] == held_back
    assert report["limits_and_balance"]["held_back_joints"] == joints


STEP = """
import numpy as np
from hoap3.tools.analysis.verdicts import judge_run
from hoap3.remote_controller.controllers.base import VelocityController


class Step(VelocityController):
    class Parameters(VelocityController.Parameters):
        from_s: float = 0.0

    def reset(self, state, last_command):
        super().reset(state, last_command)
        self.first = state.tick

    def velocity(self, state):
        u = np.zeros(self.description.n)
        if (state.tick - self.first) * self.description.period_s >= self.parameters.from_s:
            u[0] = SPEED
        return u
"""
PERIODS = 3
"""Of the robot's first joint: how often its acceleration is needed to reach the speed."""


def stepped(folder: Path, from_s: float) -> tuple[dict[str, Any], str]:
    """A run of UR5 whose first joint is to move at once, `from_s` after the start; and its line."""
    limit = float(load("ur5").setpoint_acceleration_max[0])
    speed = (PERIODS - 0.5) * limit * 1e-3
    (folder / "step.py").write_text(STEP.replace("SPEED", repr(speed)), encoding="utf-8")
    law = {"controller": "step:Step", "parameters": {"from_s": from_s}}
    (folder / "step.yaml").write_text(json.dumps(law), encoding="utf-8")
    words = ("--robot", "ur5", "--controller", folder / "step.yaml", "--duration", 0.5)
    found = inside("run", "--lockstep", *words, "--out", folder / "log", "--json").json()
    return found, found["limits_and_balance"]["text"]


def test_a_start_up_step_is_a_note_that_names_limit_and_remedy(tmp_path):
    found, text = stepped(tmp_path, 0.0)
    limits, robot = found["limits_and_balance"], load("ur5")
    assert limits["held_back"] == limits["startup_interventions"] == PERIODS - 1
    assert found["verdicts"]["limits_and_balance"] == "pass"
    assert limits["reasons"] == []
    limit = {"limit": "acceleration", "value": robot.setpoint_acceleration_max[0], "unit": "rad/s²"}
    assert limits["held_back_limit"] == limit
    assert f"{limit['value']:.4g} rad/s²" in text
    assert verify(tmp_path / "log").claims.by_tick() == []


@pytest.mark.parametrize(("from_s", "at_start"), [(0.1, PERIODS - 1), (0.3, 0)])
def test_after_200_ticks_it_fails_and_names_them_as_well(from_s, at_start, tmp_path):
    found, text = stepped(tmp_path, from_s)
    limits = found["limits_and_balance"]
    assert (limits["held_back"], limits["startup_interventions"]) == (PERIODS - 1, at_start)
    assert found["verdicts"]["limits_and_balance"] == ("pass" if at_start else "fail")
    assert limits["reasons"] == ([] if at_start else ["held_back"])
    assert "acceleration" in text


WAVE = """
controller: clik_sdp
robot: ur5
parameters:
  tasks:
    - task: posture
      parameters:
        target: {kind: trajectory, file: wave.csv, path_tolerance: TOLERANCE}
"""
POINTS = """t,elbow_joint
0.0,1.6
0.5,1.7
1.0,1.6
"""


@pytest.mark.slow
@pytest.mark.parametrize(("tolerance", "fails"), [("1.0e-9", True), ("1.0", False)])
def test_the_status_says_that_a_trajectory_left_its_tolerance(tmp_path, tolerance, fails):
    (tmp_path / "wave.csv").write_text(POINTS.lstrip())
    (tmp_path / "wave.yaml").write_text(WAVE.replace("TOLERANCE", tolerance))
    at = endpoint()
    with followed(at, ("ur5", tmp_path / "wave.yaml")):
        wait_for_mode("active", at, "ur5")
        for _ in range(60):
            found = inside("status", "ur5", "--connect", at, "--json").json()
            (task,) = found["tasks"]
            if task["reason"]:
                break
        assert bool(task["reason"]) is fails
        assert not fails or "elbow_joint" in task["reason"]
        told = inside("status", "ur5", "--connect", at).stdout
        assert ("elbow_joint" in told) is fails
        assert inside("stop", "ur5", "--connect", at).code == 0
        wait_for_mode("stopped", at, "ur5")
        assert inside("status", "ur5", "--connect", at, "--json").json()["tasks"] is None
