"""Soaks of half a minute: a robot, its controller and all that is beside them, as processes."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.command_bench import Command, assert_no_traceback, inside

pytestmark = pytest.mark.slow

SHORT = ("--warm-up-minutes", 0.03, "--no-realtime", "--json")
PATIENT = ("--set", "emulator.misses_to_stop=100000")  # busy machines miss many
NAMES = {"robot", "controller", "observer of the robot", "observer of the controller"}
ABOUT = {"memory", "descriptors", "threads", "processes", "phase", "deadlines", "log", "metrics"}


@contextmanager
def soak(minutes: float, out: Path) -> Iterator[Command]:
    with Command("soak", "--minutes", minutes, *SHORT, *PATIENT, "--out", out) as command:
        yield command
        command.assert_no_orphan()


def test_a_soak_tells_of_every_process_and_leaves_its_results_beside_the_logs(tmp_path: Path):
    with soak(0.2, tmp_path) as command:
        code = command.end()
    found = command.json()
    assert code == (0 if found["verdict"] == "pass" else 1), command.stderr
    assert found["verdicts"].keys() == ABOUT
    assert {each["name"] for each in found["processes"]} == NAMES
    assert found["measured"]["rounds"] >= 10
    assert found["measured"]["from_s"] >= found["plan"]["warm_up_s"]
    for each in found["processes"]:
        assert each["throughout"], each["name"]
        assert each["memory"]["min_mb"] > 10.0
        assert each["threads"]["min"] >= 1
    assert found["verdicts"]["phase"] == "pass"
    assert found["phase"]["drift_ns"] == 0
    assert found["phase"]["states"] > 10
    assert found["deadlines"]["ticks"] > 1000
    assert found["deadlines"]["safe_stops"] == found["run"]["safe_stops"]
    assert found["deadlines"]["in_time"] <= found["run"]["ticks"]
    assert found["log"]["most_mb"]["robot"] > 0.1
    assert found["metrics"]["asked"] >= 2 * found["measured"]["rounds"]
    assert not found["interrupted"]
    files = {path.name for path in tmp_path.iterdir()}
    parts = {f"{side}.0001.mcap" for side in ("robot", "controller")}  # of a run of over 6 MB
    assert files - parts == {"robot.mcap", "controller.mcap", "soak.json", "soak.png"}
    kept = json.loads((tmp_path / "soak.json").read_text(encoding="utf-8"))
    assert kept["processes"] == found["processes"]
    assert (tmp_path / "soak.png").read_bytes().startswith(b"\x89PNG")


def test_a_soak_that_somebody_ends_tells_what_was_measured(tmp_path: Path):
    with soak(1, tmp_path) as command:
        command.wait_for("measured since")
        assert not command.ended_within(3.0)  # some of the rounds, each 1 s after the one before
        code = command.end(signal.SIGINT)
    found = command.json()
    assert code == (0 if found["verdict"] == "pass" else 1), command.stderr
    assert found["interrupted"]
    assert found["measured"]["rounds"] >= 1
    assert {each["name"] for each in found["processes"]} == NAMES


def test_a_controller_that_dies_is_told_with_what_was_measured_until_then(tmp_path: Path):
    with soak(1, tmp_path) as command:
        command.wait_for("measured since")
        (pid,) = [pid for pid, words in command.family().items() if "controller" in words]
        os.kill(pid, signal.SIGKILL)
        code = command.end()
        assert_no_traceback(command)
    found = command.json()
    assert code == 1
    assert found["verdicts"]["processes"] == found["verdict"] == "fail"
    assert found["failure"]
    assert found["run"] is None
    assert found["measured"]["rounds"] >= 1


TIMES = ("--minutes", 5, "--hours", 1), ("--minutes", 5, "--warm-up-minutes", 5)
SETS = "emulator.log.record=false", "controller.metrics.port=null", "emulator.no_such_key=1"


@pytest.mark.parametrize("words", [*TIMES, *(("--set", each) for each in SETS)])
def test_what_makes_no_soak_is_refused_before_anything_runs(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = inside("soak", *words)
    assert done.code == 2
    assert "error: " in done.stderr
    assert list(tmp_path.iterdir()) == []
