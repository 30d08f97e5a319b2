"""What real services tell as JSON lines, in order, on standard output."""

from __future__ import annotations

import json
import signal
import time
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
    inside,
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


def wait_until_active(at: str) -> None:
    """Wait for services that tell people nothing."""
    for _ in range(1000):
        answer = inside("status", "hoap3", "--connect", at, "--json").stdout
        if answer and json.loads(answer)["mode"] == "active":
            return
        time.sleep(0.1)
    raise AssertionError("never active")


def test_a_run_is_told_in_order_by_both_services() -> None:
    at, lines = endpoint(), ("--set", "log.json_lines=stdout")
    listen = ("--set", f"link.listen=[{at}]")
    with (
        Command("emulator", "hoap3", *QUIET, *PATIENT, *lines, *listen) as robot,
        controller("qp12", *QUIET, *lines, at=at) as law,
    ):
        wait_until_active(at)
        law.send(signal.SIGKILL)  # its holder is lost: a safe stop
        wait_for_mode("stopped", at)
        assert robot.end(signal.SIGTERM) == 1
        assert law.end() == -signal.SIGKILL
        assert_no_traceback(robot)
    ours, theirs = parsed(robot.stdout), parsed(law.stdout)
    events = [line for line in ours if "tick" in line]
    assert_in_order(events, "STARTED", "GRANTED", "HOLDER_LOST", "SAFE_STOP", "AT_REST", "ENDED")
    assert {line["event"] for line in ours} >= {"said", "summary"}  # of two processes, in any order
    assert {line["event"] for line in theirs} >= {"said", "ROBOT_FOUND"}
    assert not law.stderr + robot.stderr  # it would stand in the journal twice
    for told, service in ((ours, "emulator"), (theirs, "controller")):
        assert {line["service"] for line in told} == {service}
        assert {line["robot"] for line in told} == {"hoap3"}
    (stop,) = [line for line in events if line["event"] == "SAFE_STOP"]
    assert stop["severity"] == "error"
    assert stop["tick"] > 0
    assert len({line["session"] for line in events}) == 1
    stamps = [line["monotonic_ns"] for line in events]
    assert stamps == sorted(stamps)


def test_json_twice_on_standard_output_is_refused() -> None:
    both = hoap3("emulator", "hoap3", *QUIET, "--json", "--set", "log.json_lines=stdout")
    assert both.end() == 2
    assert not both.stdout


def test_a_service_that_is_refused_says_so_in_its_lines() -> None:
    at = endpoint()
    with emulator("hoap3", *QUIET, at=at):
        words = (*QUIET, "--set", "log.json_lines=stdout", "--set", f"link.listen=[{at}]")
        second = hoap3("emulator", "hoap3", *words)
    assert second.end() == 2
    (failed,) = [line for line in parsed(second.stdout) if line["event"] == "failed"]
    assert failed["severity"] == "error"
    assert failed["text"] in second.stderr
