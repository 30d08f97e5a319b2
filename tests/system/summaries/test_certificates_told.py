"""A run whose answers prove nothing says so, however many of them were in time."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.command_bench import Done, assert_ran, hoap3, inside

pytestmark = pytest.mark.slow

FAST = "minimum_speed, parameters: {speed: 9, joints: {l_shoulder_pitch: 1.0}, tolerance: 0.9}"
CONTRADICTORY = (
    *("--controller", "stable_qp", "--set"),
    f"controller.parameters.constraints=[{{constraint: joint_velocity}}, {{constraint: {FAST}}}]",
)
LINE = "0 of 200 answers certified; 200 infeasible: infeasible_constraints"


def lockstep(*arguments: object) -> Done:
    return inside("run", "--lockstep", "--duration", 0.2, *arguments)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("infeasible_constraints") / "run"


@pytest.fixture(scope="module")
def run(folder: Path) -> Done:
    return lockstep(*CONTRADICTORY, "--out", folder)


def test_the_terminal_says_it_and_the_task_is_bad(run: Done) -> None:
    assert run.code == 1
    assert re.search(rf"certificates +{LINE}", run.stdout)
    assert re.search(r"deadlines +pass", run.stdout)
    assert re.search(r"task +fail: .*certified 0 of 200 answers", run.stdout)


def test_the_report_says_the_same_in_its_terminal_and_in_json(run: Done, folder: Path) -> None:
    told = inside("report", folder)
    assert told.code == 1
    (line,) = re.findall(r"certificates: (.+)", told.stdout)
    assert line.startswith(LINE)
    assert line.split()[-1] in run.stdout  # whatever else holds meanwhile, the run names, too
    assert "infeasible_constraints 200" in (folder / "report.html").read_text(encoding="utf-8")
    figures = inside("report", folder, "--json").json()["certificates"]
    again = lockstep(*CONTRADICTORY, "--json", "--set", "emulator.log.record=false")
    counted = again.json()["certificates"]  # without any log, too
    assert counted["reasons"]["infeasible"]["infeasible_constraints"] == 200
    assert {name: figures[name] for name in counted} == counted


def test_certificates_that_are_worth_little_are_told_though_every_answer_has_one(
    tmp_path: Path,
) -> None:
    flat = (f"controller.parameters.tasks.{place}.weight=1" for place in range(3))
    weights = [word for each in flat for word in ("--set", each)]
    slow = (*("--robot", "hoap3", "--controller", "clik_sdp_hoap3"), *weights)
    words = "beta below a tenth of what was asked"
    line = f"200 of 200 answers certified, 100 with {words}"
    folder = tmp_path / "run"
    run = lockstep(*slow, "--out", folder)
    assert_ran(run)
    assert re.search(rf"certificates +{line}", run.stdout)
    told = inside("report", folder)
    assert f"certificates: {line}" in told.stdout.splitlines()
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert f"In 100 of 200 answers a certificate says little: {words}." in text
    assert f"{words} 100" in text  # in the table of certificates
    found = inside("report", folder, "--json").json()
    assert found["certificates"]["reasons"] == {"certified": {words: 100}}
    (condition,) = (each for each in found["conditions"] if each["condition"] == words)
    assert (condition["ticks"], condition["longest"], condition["times"]) == (100, 100, 1)
    again = lockstep(*slow, "--json", "--set", "emulator.log.record=false").json()
    assert again["certificates"]["reasons"] == {"certified": {words: 100}}
    with_weights = lockstep(*slow[:4], "--out", tmp_path / "other")
    assert not re.search(r"^certificates", with_weights.stdout, re.MULTILINE)


def test_a_proved_run_has_the_counts_and_no_line(tmp_path: Path) -> None:
    command = lockstep("--out", tmp_path / "run")
    assert "certificates" not in command.stdout
    assert "certificates" not in inside("report", tmp_path / "run").stdout


def test_in_real_time_it_is_told_as_well(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    command = hoap3("run", "--duration", 1.0, *CONTRADICTORY, "--out", folder, "--json")
    assert command.end() in {0, 1}, command.stderr  # how fit this machine is, is another matter
    counted = command.json()["certificates"]
    assert counted["infeasible"] == counted["n"] > 0
    assert set(counted["reasons"]["infeasible"]) >= {"infeasible_constraints"}
    figures = inside("report", folder, "--json").json()["certificates"]
    assert {name: figures[name] for name in counted} == counted
