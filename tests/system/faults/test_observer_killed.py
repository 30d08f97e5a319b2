"""The observer of a running robot is killed: the loop goes on, and the log can be mended."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader
from support.command_bench import (
    Command,
    assert_no_traceback,
    hoap3,
    inside,
    tell,
    wait_for_end,
    wait_for_mode,
)

from hoap3.tools.logs.log import Log


@pytest.mark.slow
def test_a_killed_observer_costs_less_than_a_second_of_log(tmp_path: Path) -> None:
    folder, patient = tmp_path / "log", ("--set", "emulator.misses_to_stop=100000")
    with Command("run", "--duration", "2", *patient, "--json", "--out", folder) as run:
        at = run.hear(r"is alive at (\S+)")[1]
        tick = wait_for_mode("active", at)["tick"]
        while tell("status", at)["tick"] < tick + 300:
            continue
        killed = time.monotonic_ns()
        observer = observer_of_the_robot(run)
        os.kill(observer, signal.SIGKILL)
        wait_for_end(observer)
        run.hear("robot's log is not whole: its observer was killed by signal 9")
        tick = tell("status", at)["tick"]
        while (status := tell("status", at))["tick"] < tick + 300:
            continue
        assert status["mode"] == "active"  # the loop has not noticed
        assert run.end() == 1
        run.assert_no_orphan()
    assert_no_traceback(run)
    assert run.stdout == ""  # the observer would have counted
    errors = [line for line in run.stderr.splitlines() if line.startswith("error:")]
    assert len(errors) == 1
    assert errors[0].startswith("error: the robot's log is not whole: its observer was killed")
    assert "`hoap3 record --repair` mends" in errors[0]
    assert not Log.open(folder, side="controller").truncated
    assert_it_can_be_mended(folder / "robot.mcap", killed)


def observer_of_the_robot(run: Command) -> int:
    """Process id of the observer that writes the robot's log."""
    for pid, words in run.family().items():
        if "hoap3.tools.services.observer" in words:
            handles = [handle.resolve() for handle in Path(f"/proc/{pid}/fd").iterdir()]
            if "robot.mcap" in {handle.name for handle in handles}:
                return pid
    raise AssertionError(f"none among {run.family()}")


def assert_it_can_be_mended(damaged: Path, killed: int) -> None:
    assert Log.open(damaged).truncated
    mended = hoap3("record", "--repair", damaged, "--json")
    assert mended.end() == 0, mended.stderr
    report = mended.json()
    assert not report["whole"]
    whole = Path(report["out"])
    with whole.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert 0 < killed - summary.statistics.message_end_time < 1_000_000_000
    assert len(Log.open(whole).states()) > 0
    again = inside("record", "--repair", whole)
    assert again.code == 0
    assert "is whole" in again.stdout
