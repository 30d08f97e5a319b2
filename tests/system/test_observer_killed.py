"""The observer of a running robot is killed: the loop goes on, and the log can be mended."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from command_bench import (
    Command,
    assert_no_traceback,
    controller,
    emulator,
    endpoint,
    hoap3,
    inside,
    tell,
    wait_for_end,
    wait_for_mode,
)
from mcap.reader import make_reader

from tools.log import Log

QUIET = ("--set", "log.record=false")


def test_a_killed_observer_costs_less_than_a_second_of_log(tmp_path: Path) -> None:
    at, folder = endpoint(), tmp_path / "robot"
    with (
        emulator("hoap3", "--out", folder, at=at) as robot,
        controller("qp12", *QUIET, at=at) as law,
    ):
        law.hear("following robot")
        tick = wait_for_mode("active", at)["tick"]
        while tell("status", at)["tick"] < tick + 300:
            continue
        observer = robot.observer()
        killed = time.monotonic_ns()
        os.kill(observer, signal.SIGKILL)
        wait_for_end(observer)
        tick = tell("status", at)["tick"]
        while (status := tell("status", at))["tick"] < tick + 300:
            continue
        assert status["mode"] == "active"  # the loop has not noticed
        assert law.end(signal.SIGTERM) == 0
        wait_for_mode("idle", at)
        assert robot.end(signal.SIGTERM) == 0
        assert_no_traceback(robot)
    assert "the log is not whole" in robot.stderr
    damaged = folder / "robot.mcap"
    assert Log.open(damaged).truncated
    mended = hoap3("record", "--repair", damaged, "--json")
    assert mended.end() == 0, mended.stderr
    report = mended.json()
    assert not report["whole"]
    with Path(report["out"]).open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert 0 < killed - summary.statistics.message_end_time < 1_000_000_000
    assert len(Log.open(Path(report["out"])).states()) > 0
    again = inside("record", "--repair", Path(report["out"]))
    assert again.code == 0
    assert "is whole" in again.stderr


def test_a_run_without_its_observer_says_so(tmp_path: Path) -> None:
    with Command("run", "--duration", "2", "--json", "--out", tmp_path / "log") as run:
        run.hear("following robot")
        observers = [pid for pid, words in run.family().items() if "tools.observer" in words]
        for pid in observers:
            os.kill(pid, signal.SIGKILL)
        assert run.end() == 1
        run.assert_no_orphan()
    assert_no_traceback(run)
    assert run.stdout == ""
    errors = [line for line in run.stderr.splitlines() if line.startswith("error:")]
    assert len(errors) == 1
    assert "the log is not whole" in errors[0]
    assert "--repair" in errors[0]
