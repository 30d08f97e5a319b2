"""What real services tell as JSON lines, in order, into a file and on standard output."""

from __future__ import annotations

import json
import shutil
import signal
from pathlib import Path
from typing import Any

import pytest
from support.command_bench import (
    PATIENT,
    QUIET,
    Command,
    assert_no_traceback,
    controller,
    emulator,
    endpoint,
    hoap3,
    wait_for_mode,
)

pytestmark = pytest.mark.slow


def parsed(text: str) -> list[dict[str, Any]]:
    """Every line of a text; each is an object."""
    return [json.loads(line) for line in text.splitlines()]


def assert_in_order(lines: list[dict[str, Any]], *expected: str) -> None:
    """These events came, in this order, perhaps with others between them."""
    events = iter(line["event"] for line in lines)
    assert all(name in events for name in expected), [line["event"] for line in lines]


def test_a_run_is_told_in_order_by_both_services(tmp_path: Path) -> None:
    at, file = endpoint(), tmp_path / "robot.jsonl"
    with (
        emulator(
            *("hoap3", *QUIET, *PATIENT, "--json", "--set", f"log.json_lines={file}"), at=at
        ) as robot,
        controller("qp12", *QUIET, "--set", "log.json_lines=stdout", at=at) as law,
    ):
        wait_for_mode("active", at)
        session = robot_session(robot, file)
        law.send(signal.SIGKILL)  # its holder is lost: a safe stop
        robot.hear("safe stop")
        assert robot.end(signal.SIGTERM) == 1
        assert law.end() == -signal.SIGKILL
        assert_no_traceback(robot)
    ours, theirs = parsed(file.read_text()), parsed(law.stdout)
    assert_in_order(
        ours,
        *("said", "STARTED", "GRANTED", "HOLDER_LOST", "SAFE_STOP", "AT_REST", "ENDED", "summary"),
    )
    events = {line["event"] for line in theirs}  # of two processes, in whatever order
    assert events >= {"said", "ROBOT_FOUND"}
    assert not law.stderr  # nothing for people: it would stand in the journal twice
    for lines, service in ((ours, "emulator"), (theirs, "controller")):
        assert {line["service"] for line in lines} == {service}
        assert {line["robot"] for line in lines} == {"hoap3"}
    (stop,) = [line for line in ours if line["event"] == "SAFE_STOP"]
    assert stop["severity"] == "error"
    assert stop["tick"] > 0
    assert stop["session"] == session
    stamps = [line["monotonic_ns"] for line in ours if "tick" in line]
    assert stamps == sorted(stamps)
    said = [line["text"] for line in ours if line["event"] == "said"]
    assert all(text in robot.stderr for text in said)  # people hear the same
    assert robot.json()["ticks"] > 0


def robot_session(robot: Command, file: Path) -> str:
    """The session that the lines of a robot that runs name."""
    robot.hear("granted")
    (granted,) = [line for line in parsed(file.read_text()) if line["event"] == "GRANTED"]
    session: str = granted["session"]
    return session


def test_lines_that_cannot_be_written_are_refused_before_anything_begins(tmp_path: Path) -> None:
    logs, file = tmp_path / "logs", "none/robot.jsonl"
    words = ("emulator", "hoap3", "--out", logs, "--set", f"log.json_lines={file}")
    done = hoap3(*words, cwd=tmp_path)
    assert done.end() == 2
    assert file in done.stderr
    assert not logs.exists()
    both = hoap3("emulator", "hoap3", *QUIET, "--json", "--set", "log.json_lines=stdout")
    assert both.end() == 2
    assert not both.stdout


def test_lines_that_cannot_be_written_any_more_end_nothing(tmp_path: Path) -> None:
    at, folder = endpoint(), tmp_path / "lines"
    folder.mkdir()
    file = folder / "robot.jsonl"
    with (
        emulator(*("hoap3", *QUIET, *PATIENT, "--set", f"log.json_lines={file}"), at=at) as robot,
        controller("qp12", *QUIET, at=at) as law,
    ):
        wait_for_mode("active", at)
        shutil.rmtree(folder)
        assert law.end(signal.SIGTERM) == 0
        robot.hear("JSON lines are missing")
        robot.hear("released")
        wait_for_mode("idle", at)
        folder.mkdir()
        robot.end(signal.SIGTERM)
        assert robot.stderr.count("JSON lines are missing") == 1
        assert_no_traceback(robot)
    lines = parsed(file.read_text())
    assert_in_order(lines, "lines_lost", "ENDED", "summary")
    assert lines[0]["lines"] >= 1


def test_a_service_that_is_refused_says_so_in_its_lines(tmp_path: Path) -> None:
    at, file = endpoint(), tmp_path / "second.jsonl"
    with emulator("hoap3", *QUIET, at=at):
        words = (*QUIET, "--set", f"log.json_lines={file}", "--set", f"link.listen=[{at}]")
        second = hoap3("emulator", "hoap3", *words)
    assert second.end() == 2
    (failed,) = [line for line in parsed(file.read_text()) if line["event"] == "failed"]
    assert failed["severity"] == "error"
    assert failed["text"] in second.stderr
