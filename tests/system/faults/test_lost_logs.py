"""A log that is lost while something runs: told at once, in the summary, and by the exit code."""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path

import pytest
from support import HOUSE
from support.command_bench import (
    PATIENT,
    QUIET,
    Command,
    assert_no_traceback,
    controller,
    emulator,
    endpoint,
    hoap3,
    on_path,
    tell,
    wait_for_end,
    wait_for_mode,
)

from hoap3.tools.logs.log import Log

pytestmark = pytest.mark.slow

LIMITED = on_path(HOUSE / "tests" / "support" / "other_machine")
LOST = "the {}'s log is not whole: {}; `hoap3 record --repair` mends what there is"
PATIENT_RUN = ("--set", "emulator.misses_to_stop=100000")


def observer_of(command: Command, log: str, at: str) -> int:
    """Process id of the observer that writes a log, of a command that goes on meanwhile."""
    for _ in range(100):
        for pid, words in command.family().items():
            if "hoap3.tools.services.observer" in words:
                handles = [handle.resolve() for handle in Path(f"/proc/{pid}/fd").iterdir()]
                if log in {handle.name for handle in handles}:
                    return pid
        wait_for_ticks(at, 50)  # it has only begun
    raise AssertionError(f"none among {command.family()}")


def wait_for_ticks(at: str, count: int) -> None:
    """Return once the robot, which moves, has gone on for so many ticks."""
    tick = tell("status", at)["tick"]
    while wait_for_mode("active", at)["tick"] < tick + count:
        continue


def test_a_full_disk_in_lockstep(tmp_path: Path) -> None:
    out, limit = tmp_path / "log", {**LIMITED, "MOST_BYTES": "150000"}
    words = ("run", "--controller", "qp12", "--lockstep", "--duration", 2, "--json", "--out", out)
    with hoap3(*words, environment=limit) as run:
        assert run.end() == 1
        assert_no_traceback(run)
        lost = [LOST.format(side, "File too large") for side in ("robot", "controller")]
        assert sorted(run.json()["log_lost"]) == sorted(lost)
        for line in lost:
            assert run.stderr.count(line) == 1
        assert run.json()["ticks"] == 2000  # all of them were counted
    log = Log.open(out, side="robot")
    assert log.truncated
    assert 0 < len(log.states()) < 2000


@pytest.mark.long
@pytest.mark.parametrize("side", ["robot", "controller"])
def test_a_folder_that_is_deleted_while_a_service_runs(tmp_path: Path, side: str) -> None:
    at, out = endpoint(), tmp_path / "log"
    kept = dict.fromkeys(("robot", "controller"), QUIET) | {side: ("--out", out)}
    with (
        emulator("hoap3", *PATIENT, "--json", *kept["robot"], at=at) as robot,
        controller("qp12", *kept["controller"], at=at) as law,
    ):
        wait_for_mode("active", at)
        shutil.rmtree(out)
        loser = robot if side == "robot" else law
        loser.hear(rf"{side}'s log is not whole: .* was deleted while it was written")
        wait_for_ticks(at, 100)  # both go on
        assert law.end(signal.SIGTERM) == (side == "controller")
        assert robot.end(signal.SIGTERM) >= (side == "robot")  # or the task is not done
        assert len(robot.json()["log_lost"]) == (side == "robot")
        assert_no_traceback(robot)
        assert_no_traceback(law)


@pytest.mark.long
def test_a_folder_that_is_deleted_while_somebody_records_into_it(tmp_path: Path) -> None:
    at, out = endpoint(), tmp_path / "log"
    with (
        emulator("hoap3", *QUIET, at=at),
        Command("record", "--connect", at, "--out", out) as recorder,
    ):
        recorder.hear("recording robot")
        shutil.rmtree(out)
        assert recorder.end() == 1
        assert_no_traceback(recorder)
        assert recorder.stderr.count("error:") == 1
        assert "was deleted while it was written" in recorder.stderr


@pytest.mark.long
@pytest.mark.parametrize("side", ["robot", "controller"])
def test_a_killed_observer_of_a_service(tmp_path: Path, side: str) -> None:
    at, out = endpoint(), tmp_path / "log"
    with (
        emulator("hoap3", *PATIENT, "--out", out, at=at) as robot,
        controller("qp12", "--out", out, at=at) as law,
    ):
        wait_for_mode("active", at)
        loser, other = (robot, law) if side == "robot" else (law, robot)
        os.kill(observer_of(loser, f"{side}.mcap", at), signal.SIGKILL)
        loser.hear(f"{side}'s log is not whole: its observer was killed by signal 9")
        wait_for_ticks(at, 100)
        assert law.end(signal.SIGTERM) == (side == "controller")
        assert robot.end(signal.SIGTERM) >= (side == "robot")  # or the task is not done
        assert "not whole" not in other.stderr
        loser.assert_no_orphan()


def test_a_killed_observer_of_the_controller_in_a_run(tmp_path: Path) -> None:
    words = ("--duration", 2, "--json", "--out", tmp_path / "log", *PATIENT_RUN)
    with Command("run", *words) as run:
        at = run.hear(r"is alive at (\S+)")[1]
        wait_for_mode("active", at)
        observer = observer_of(run, "controller.mcap", at)
        os.kill(observer, signal.SIGKILL)
        wait_for_end(observer)
        lost = LOST.format("controller", "its observer was killed by signal 9")
        run.hear(lost)
        assert tell("status", at)["mode"] == "active"
        assert run.end() == 1
        run.assert_no_orphan()
        assert run.json()["log_lost"] == [lost]
    assert not Log.open(tmp_path / "log", side="robot").truncated
