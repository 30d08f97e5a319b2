"""A controller that fails in full motion: the robot stops, the error has a name and a place."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.command_bench import (
    Command,
    assert_at_rest,
    assert_no_traceback,
    events,
    hoap3,
    inside,
)

from hoap3.tools.logs.log import Log

pytestmark = pytest.mark.slow

CODE = """
import numpy as np
from hoap3.remote_controller.controllers.base import VelocityController


class Fails(VelocityController):
    steps = -200  # those of the rehearsal

    def velocity(self, state):
        self.steps += 1
        if state.mode == state.ACTIVE and self.steps > 100:
            {failure}
        return np.full(self.description.n, 0.1)
"""
RAISES = "raise ZeroDivisionError('a mistake\\nof mine')"
GIVES_NAN = "return np.full(self.description.n, np.nan)"


def run_of(folder: Path, failure: str, *words: str) -> Command:
    """A run of a controller that fails after some hundred steps."""
    (folder / "failing_law.py").write_text(CODE.format(failure=failure))
    path = folder / "law.yaml"
    path.write_text("controller: failing_law:Fails\n")
    return hoap3("run", *words, "--controller", path, "--out", folder / "log")


@pytest.mark.parametrize("mode", ["--lockstep", "--no-realtime"])
def test_a_controller_that_raises(tmp_path, mode):
    given = "--duration", "60", "--json", "--set", "emulator.misses_to_stop=10000"
    run = run_of(tmp_path, RAISES, mode, *given)
    assert run.end() == 1
    assert run.stdout == ""
    assert_no_traceback(run)
    errors = [line for line in run.stderr.splitlines() if line.startswith("error:")]
    assert len(errors) == 1
    told = re.search(r"Fails.*tick (\d+).*ZeroDivisionError.*failing_law\.py, line 12", errors[0])
    assert told
    log = Log.open(tmp_path / "log", side="robot")
    assert not log.truncated
    assert_at_rest(log)
    kinds = [kind for kind, _ in events(log)]
    assert "SAFE_STOP" in kinds
    assert kinds[-1] == "ENDED"
    assert len(log.setpoints()) >= 50
    controller = Log.open(tmp_path / "log", side="controller")
    assert controller.states()["tick"][-1] == int(told[1])  # what it failed on is there
    run.assert_no_orphan()


@pytest.mark.parametrize(
    ("failure", "error"),
    [
        ("raise SystemExit(0)", "SystemExit: 0 (failing_law.py, line 12)"),
        pytest.param("return None", "Fails.velocity gave None", marks=pytest.mark.long),
    ],
)
def test_a_controller_that_ends_everything_or_gives_nothing(tmp_path, failure, error):
    run = run_of(tmp_path, failure, "--lockstep")
    assert run.end() == 1
    assert error in run.stderr
    assert_at_rest(Log.open(tmp_path / "log", side="robot"))


@pytest.mark.parametrize(
    "mode", ["--lockstep", pytest.param("--no-realtime", marks=pytest.mark.long)]
)
def test_a_controller_that_answers_nan(tmp_path, mode):
    run = run_of(tmp_path, GIVES_NAN, mode, "--duration", "0.5", "--json")
    assert run.end() == 1
    assert_no_traceback(run)
    summary = run.json()
    assert summary["verdicts"]["deadlines"] == "fail"
    assert summary["safe_stops"] == 1
    assert summary["rejections"]["not_finite"] > 0
    assert summary["misses"]["longest_run"] >= 20
    log = Log.open(tmp_path / "log", side="robot")
    assert ("SAFE_STOP", 1) in events(log)  # for misses
    assert_at_rest(log)
    assert inside("replay", tmp_path / "log", "--allow-code").code == 2  # not on the import path
