"""Lockstep between two processes: the same messages over Zenoh, in virtual time."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
from support.command_bench import (
    QUIET,
    Command,
    assert_at_rest,
    assert_no_traceback,
    controller,
    emulator,
    endpoint,
    events,
    inside,
    tell,
    wait_for_mode,
)

from hoap3.protocol.messages import Setpoint
from hoap3.tools.logs.log import Log
from hoap3.tools.simulate import simulate

SEED = 5


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("lockstep") / "log"


@pytest.fixture(scope="module")
def pair(folder: Path) -> tuple[Command, Command]:
    """A robot and its controller that have run for a second of virtual time."""
    at = endpoint()
    words = ("hoap3", "--lockstep", "--duration", "1", "--set", f"seed={SEED}", "--out", folder)
    with emulator(*words, at=at) as robot, controller("qp12", "--out", folder, at=at) as law:
        assert robot.end() == 0, robot.stderr
        law.hear("is gone")
        assert law.end(signal.SIGTERM) == 0, law.stderr
        assert_no_traceback(robot)
        assert_no_traceback(law)
    return robot, law


def test_every_tick_is_answered_in_virtual_time(pair: object, folder: Path) -> None:
    log = Log.open(folder, side="robot")
    assert len(log.setpoints()) == 1000
    last = log.states()[-1]
    assert last["late"] == last["lost"] == last["skipped"] == last["rejected"] == 0
    assert_at_rest(log)


def test_the_controllers_log_is_repeated_bit_by_bit(pair: object, folder: Path) -> None:
    again = inside("replay", folder)
    assert again.code == 0
    assert "1000/1000 setpoints identical" in again.stdout


def test_setpoints_are_those_of_one_process(pair: object, folder: Path) -> None:
    """All of every payload is: time is virtual, and the session is named by the seed."""
    alone = simulate("hoap3", "qp12", duration=1.0, seed=SEED)
    together = Log.open(folder, side="controller").setpoints()
    assert together.dtype == alone.setpoints.dtype
    for name in Setpoint.schema.scalars | dict.fromkeys(Setpoint.schema.arrays):
        assert np.array_equal(together[name], alone.setpoints[name]), name
    assert together.tobytes() == alone.setpoints.tobytes()


def test_states_are_those_of_one_process(pair: object, folder: Path) -> None:
    alone = simulate("hoap3", "qp12", duration=1.0, seed=SEED)
    assert Log.open(folder, side="robot").states().tobytes() == alone.states.tobytes()


@pytest.mark.long
def test_a_robot_without_end_waits_for_the_next_controller(tmp_path: Path) -> None:
    """A holder that leaves is noticed while its answer is waited for, however it leaves."""
    at, out = endpoint(), tmp_path / "robot"
    with emulator("hoap3", "--lockstep", "--out", out, at=at) as robot:
        for number, mode in ((signal.SIGTERM, "idle"), (signal.SIGKILL, "stopped")):
            with controller("qp12", *QUIET, at=at) as law:
                law.hear("following robot")
                wait_for_mode("active", at)
                assert law.end(number) == (0 if number == signal.SIGTERM else -number)
            stood = wait_for_mode(mode, at)["tick"]
            assert tell("status", at)["tick"] == stood  # and time with it
        assert tell("recover", at)["recovered"]
        wait_for_mode("idle", at)
        assert robot.end(signal.SIGTERM) == 1  # there was a safe stop
        assert_no_traceback(robot)
    log = Log.open(out, side="robot")
    kinds = [event for event in events(log) if event[0] in {"GRANTED", "RELEASED", "HOLDER_LOST"}]
    assert kinds == [("GRANTED", 1), ("RELEASED", 1), ("GRANTED", 2), ("HOLDER_LOST", 2)]
    assert_at_rest(log)
