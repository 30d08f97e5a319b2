"""Logs that are damaged or lost while something runs, and slow recorders."""

from __future__ import annotations

import json
import os
import shutil
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from support import HOUSE
from support.command_bench import (
    PATIENT,
    QUIET,
    Command,
    assert_no_traceback,
    emulator,
    endpoint,
    followed,
    hoap3,
    inside,
    observer_of,
    on_path,
    wait_for_end,
    wait_for_mode,
    wait_for_ticks,
)
from support.fake_robot import FakeRobot

from hoap3.protocol.runtime.shm_ring import Kind, Record, Ring
from hoap3.robot_emulator.robots import load
from hoap3.tools.logs.log import Log
from hoap3.tools.logs.log_writer import LogWriter
from hoap3.tools.services import record

LIMITED = on_path(HOUSE / "tests" / "support" / "other_machine")
LOST = "the {}'s log is not whole: {}; `hoap3 record --repair` repairs what is left"
PATIENT_RUN = ("--set", "emulator.misses_to_stop=100000")


@pytest.mark.slow
def test_a_full_disk_in_lockstep(tmp_path):
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
def test_a_folder_that_is_deleted_while_a_service_runs(tmp_path, side):
    at, out = endpoint(), tmp_path / "log"
    kept = dict.fromkeys(("robot", "controller"), QUIET) | {side: ("--out", out)}
    ours = *PATIENT, "--json", *kept["robot"]
    with followed(at, robot=ours, law=kept["controller"]) as (robot, law):
        wait_for_mode("active", at)
        shutil.rmtree(out)
        loser = robot if side == "robot" else law
        loser.wait_for(rf"{side}'s log is not whole: .* was deleted while it was written")
        wait_for_ticks(at, 100)  # both go on
        assert law.end(signal.SIGTERM) == (side == "controller")
        assert robot.end(signal.SIGTERM) >= (side == "robot")  # or the task is not done
        assert len(robot.json()["log_lost"]) == (side == "robot")
        assert_no_traceback(robot)
        assert_no_traceback(law)


@pytest.mark.long
def test_a_folder_that_is_deleted_while_somebody_records_into_it(tmp_path):
    at, out = endpoint(), tmp_path / "log"
    with (
        emulator("hoap3", *QUIET, at=at),
        Command("record", "--connect", at, "--out", out) as recorder,
    ):
        recorder.wait_for("recording robot")
        shutil.rmtree(out)
        assert recorder.end() == 1
        assert_no_traceback(recorder)
        assert recorder.stderr.count("error:") == 1


@pytest.mark.long
@pytest.mark.parametrize("side", ["robot", "controller"])
def test_a_killed_observer_of_a_service(tmp_path, side):
    at, out = endpoint(), tmp_path / "log"
    with followed(at, robot=(*PATIENT, "--out", out), law=("--out", out)) as (robot, law):
        wait_for_mode("active", at)
        loser, other = (robot, law) if side == "robot" else (law, robot)
        os.kill(observer_of(loser, f"{side}.mcap", at), signal.SIGKILL)
        loser.wait_for(f"{side}'s log is not whole: its observer was killed by signal 9")
        wait_for_ticks(at, 100)
        assert law.end(signal.SIGTERM) == (side == "controller")
        assert robot.end(signal.SIGTERM) >= (side == "robot")  # or the task is not done
        assert "not whole" not in other.stderr
        loser.assert_no_orphan()


@pytest.mark.slow
@pytest.mark.parametrize("side", ["robot", "controller"])
def test_a_killed_observer_in_a_run_costs_less_than_a_second_of_log(side, tmp_path):
    folder = tmp_path / "log"
    with Command("run", "--duration", 3, *PATIENT_RUN, "--json", "--out", folder) as run:
        at = run.wait_for(r"is alive at (\S+)")[1]
        wait_for_ticks(at, 300)
        killed = time.monotonic_ns()
        observer = observer_of(run, f"{side}.mcap", at)
        os.kill(observer, signal.SIGKILL)
        wait_for_end(observer)
        lost = LOST.format(side, "its observer was killed by signal 9")
        run.wait_for(lost)
        wait_for_ticks(at, 300)  # the loop has not noticed
        assert run.end() == 1
        run.assert_no_orphan()
    assert_no_traceback(run)
    if side == "controller":
        assert run.json()["log_lost"] == [lost]
        assert not Log.open(folder, side="robot").truncated
        return
    assert run.stdout == ""  # the observer would have counted
    errors = [line for line in run.stderr.splitlines() if line.startswith("error:")]
    assert errors == [f"error: {lost}"]
    assert not Log.open(folder, side="controller").truncated
    assert_it_can_be_repaired(folder / "robot.mcap", killed)


def assert_it_can_be_repaired(damaged: Path, killed: int) -> None:
    assert Log.open(damaged).truncated
    repaired = hoap3("record", "--repair", damaged, "--json")
    assert repaired.end() == 0, repaired.stderr
    report = repaired.json()
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


@pytest.mark.slow
def test_commands_skip_a_damaged_chunk_and_say_so(tmp_path):
    folder = tmp_path / "log"
    run = inside("run", "--lockstep", "--duration", 2, "--out", folder, "--json")
    assert run.json()["ticks"] > 1900
    path = folder / "controller.mcap"
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[2]
    content = bytearray(path.read_bytes())
    content[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    path.write_bytes(content)
    log = Log.open(path)
    ticks = log.states()["tick"]
    last = int(ticks[np.argmax(np.diff(ticks))])

    out = tmp_path / "out.csv"
    exported = inside("export", path, "--to", out)
    assert exported.code == 1
    rows = exported.stdout.removeprefix(f"{out}: ").partition(" rows; ")
    assert rows[2].startswith(f"{len(ticks)} states, {len(log.setpoints())} setpoints; without ")
    assert int(rows[0]) >= len(ticks)  # a Setpoint at an edge of the gap may have no State

    again = inside("replay", path, "--json")
    assert again.json()["gap"] == last
    assert again.json()["identical"]
    assert again.json()["missing"]

    repaired = inside("record", "--repair", path, "--json").json()
    assert repaired["dropped_bytes"] == 0
    assert repaired["damaged"]
    assert np.array_equal(Log.open(repaired["out"]).states()["tick"], ticks)
    assert inside("replay", repaired["out"], "--json").json()["gap"] == last
    assert inside("export", repaired["out"], "--to", out).code == 1


def test_a_flood_neither_fills_memory_nor_keeps_it_from_stopping(tmp_path, monkeypatch):
    """Two more records are heard while each one is written."""
    ring = Ring(slots=64)
    added: list[Record] = []

    class SlowWriter(LogWriter):
        def add(self, record: Record) -> None:
            added.append(record)
            assert len(added) < 100_000
            super().add(record)
            for _ in range(2):
                ring.write(Kind.EVENT, record.stamp + 1, b"x")

    monkeypatch.setattr(record, "Ring", lambda: ring)
    monkeypatch.setattr(record, "LogWriter", SlowWriter)
    said: list[str] = []
    description, at = load("hoap3").to_json(), endpoint()
    robot = FakeRobot(at, lambda verb, _: description if verb == "description" else None)
    try:
        outcome = record.record_robot("hoap3", at, tmp_path / "out", 0.2, said.append)
    finally:
        robot.close()
    logged = [r for r in Log.open(tmp_path / "out").records() if r.kind == Kind.GAP]
    assert logged == [r for r in added if r.kind == Kind.GAP]
    dropped = sum(json.loads(gap.payload)["dropped"] for gap in logged)
    assert 0 < dropped <= outcome["dropped"]
    left = ring.slots - ring.free
    assert outcome["dropped"] + outcome["events"] + left >= 2 * (len(added) - len(logged))
    assert f"{outcome['dropped']} records" in said[-1]
