"""SIGINT and SIGTERM at random moments: the robot at rest, the log closed, nobody left behind."""

from __future__ import annotations

import random
import signal
from pathlib import Path

import pytest
from mcap.reader import make_reader
from support.command_bench import (
    PATIENCE_S,
    PATIENT,
    QUIET,
    STOPS,
    Command,
    assert_at_rest,
    assert_no_traceback,
    controller,
    emulator,
    endpoint,
)

from hoap3.tools.logs.log import Log

pytestmark = pytest.mark.slow

LATEST_S = {"run": 3.0, "emulator": 1.2, "controller": 2.5}


def moments(command: str, count: int, seed: int) -> list[tuple[str, int, float, bool]]:
    """Which command, signal, moment after its start [s], and whether it comes twice."""
    chance = random.Random(f"{command} {seed}")
    return [
        (command, STOPS[number % 2], chance.uniform(0.0, LATEST_S[command]), number % 3 == 1)
        for number in range(count)
    ]


def interrupted(command: Command, number: int, after_s: float, *, twice: bool) -> int:
    """Exit code of a command that got a signal `after_s` seconds after its start."""
    if command.ended_within(after_s):
        return command.end()
    command.send(number)
    if twice and command.process.poll() is None:
        command.send(number)
    return command.end()


def check(command: Command, code: int, number: int, folder: Path, allowed: set[int]) -> None:
    """The end was an orderly one, or came before the command had done anything."""
    command.assert_no_orphan()
    if not folder.exists():  # nothing had begun; Python and the shell have their own codes then
        assert code in {0, 1, 128 + number, -number}
        return
    assert code in allowed, command.stderr
    assert_no_traceback(command)
    for path in sorted(folder.glob("*.mcap")):
        with path.open("rb") as stream:
            assert make_reader(stream).get_summary() is not None
        log = Log.open(path)
        assert not log.truncated
        if log.side == "robot" and len(log.states()):
            assert_at_rest(log)


def end_anyhow(command: str, number: int, after_s: float, twice: bool, folder: Path) -> None:
    at = endpoint()
    if command == "run":
        with Command("run", "--duration", PATIENCE_S, "--out", folder) as run:
            code = interrupted(run, number, after_s, twice=twice)
            check(run, code, number, folder, {0, 1})
    elif command == "emulator":
        words = ("emulator", "hoap3", "--out", folder, "--set", f"link.listen=[{at}]")
        with Command(*words) as robot:
            code = interrupted(robot, number, after_s, twice=twice)
            check(robot, code, number, folder, {0})
    else:
        with (
            emulator("hoap3", *QUIET, at=at) as robot,
            controller("qp12", "--out", folder, at=at) as law,
        ):
            code = interrupted(law, number, after_s, twice=twice)
            check(law, code, number, folder, {0})
            assert robot.end(signal.SIGTERM) in {0, 1}  # 1: a busy machine made it stop before


@pytest.mark.parametrize(
    ("command", "number", "after_s", "twice"),
    list(moments("run", 1, seed=1)),
)
def test_an_end_at_any_moment_is_orderly(
    tmp_path: Path, command: str, number: int, after_s: float, twice: bool
) -> None:
    end_anyhow(command, number, after_s, twice, tmp_path / "log")


@pytest.mark.long
@pytest.mark.parametrize(
    ("command", "number", "after_s", "twice"),
    [moment for command in LATEST_S for moment in moments(command, 20, seed=2)],
)
def test_an_end_at_any_of_many_moments_is_orderly(
    tmp_path: Path, command: str, number: int, after_s: float, twice: bool
) -> None:
    end_anyhow(command, number, after_s, twice, tmp_path / "log")


def test_an_end_in_full_motion_is_orderly(tmp_path: Path) -> None:
    folder = tmp_path / "log"
    patient = [word.replace("misses", "emulator.misses") for word in PATIENT]
    for side in ("emulator", "controller"):  # a busy machine may be silent for longer than a lease
        patient += ["--set", f"{side}.link.lease_ms=60000"]
    with Command("run", "--duration", PATIENCE_S, "--json", "--out", folder, *patient) as run:
        first = int(run.hear(r"following robot 'hoap3' from tick (\d+)")[1])
        reset = r"controller: tick (\d+): reset"
        if int(run.hear(reset)[1]) < first:  # what comes before does not count, if anything does
            run.hear(reset, 2)
        code = run.end(signal.SIGINT)
        check(run, code, signal.SIGINT, folder, {0, 1})
    summary = run.json()
    assert summary["ticks"] > 0
    assert code == (1 if {"fail"} & {*summary["verdicts"].values()} else 0)
    assert {path.name for path in folder.iterdir()} == {"robot.mcap", "controller.mcap"}


def test_nothing_survives_a_killed_run(tmp_path: Path) -> None:
    with Command("run", "--duration", PATIENCE_S, "--out", tmp_path / "log") as run:
        run.hear(r"following robot")
        assert len(run.family()) == 4  # two services, an observer beside each
        assert run.end(signal.SIGKILL) == -signal.SIGKILL
        run.assert_no_orphan()
    for side in ("robot", "controller"):
        assert not Log.open(tmp_path / "log", side=side).truncated
    assert_at_rest(Log.open(tmp_path / "log", side="robot"))
