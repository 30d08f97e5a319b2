"""A disk that is full and descriptors that are used up, while a robot runs: it does not notice."""

from __future__ import annotations

import os
import resource
import signal
from pathlib import Path

import pytest
from support.command_bench import (
    PATIENCE_S,
    PATIENT,
    QUIET,
    assert_no_traceback,
    controller,
    emulator,
    endpoint,
    tell,
    wait_for_mode,
)

import hoap3
from hoap3.protocol.link.local_control import local_robots

pytestmark = pytest.mark.slow

SMALL_DISK = (
    *("unshare", "--mount", *(() if os.geteuid() == 0 else ("--map-root-user",))),
    *("sh", "-c", 'mount -t tmpfs -o size=600k tmpfs "$0" && exec "$@"'),
)


def use_up_descriptors(pid: int) -> tuple[int, int]:
    """Let a process open no more files than it has now; its limits before."""
    used = {int(entry.name) for entry in Path(f"/proc/{pid}/fd").iterdir()}
    free = next(number for number in range(len(used) + 1) if number not in used)
    before = resource.prlimit(pid, resource.RLIMIT_NOFILE)
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (free, before[1]))
    return before


def assert_goes_on(at: str) -> None:
    """It still follows its controller, and its ticks come."""
    tick = tell("status", at)["tick"]
    while wait_for_mode("active", at)["tick"] < tick + 200:
        continue


def test_a_full_disk_costs_the_log_alone(tmp_path: Path) -> None:
    at = endpoint()
    with (
        emulator(
            *("hoap3", *PATIENT, "--out", tmp_path / "log", "--json"),
            at=at,
            wrapper=(*SMALL_DISK, str(tmp_path)),
        ) as robot,
        hoap3.connect("hoap3", at) as connection,
        controller("qp12", *QUIET, at=at) as law,
    ):
        assert "LOG_LOST" in (event["event"] for event in connection.events(PATIENCE_S))
        robot.hear("robot's log is not whole: No space left on device")
        robot.hear(r"tick \d+: log lost \(No space left on device")
        assert_goes_on(at)
        assert robot.end(signal.SIGTERM) == 1
        assert robot.stderr.count("log is not whole") == 1
        assert len(robot.json()["log_lost"]) == 1
        assert robot.json()["ticks"] > 200  # counted to the end
        assert law.end(signal.SIGTERM) == 0
        assert_no_traceback(robot)
        robot.assert_no_orphan()


def test_a_robot_without_descriptors_serves_whom_it_knows_and_then_all(tmp_path: Path) -> None:
    at = endpoint()
    with (
        emulator("hoap3", *PATIENT, "--out", tmp_path, at=at) as robot,
        controller("qp12", *QUIET, at=at) as law,
        hoap3.connect("hoap3", at) as connection,
    ):
        wait_for_mode("active", at)
        (local,) = [one for one in local_robots() if one.pid == robot.process.pid]
        before = use_up_descriptors(robot.process.pid)
        tick = connection.status()["tick"]
        while (status := connection.status())["tick"] < tick + 200:
            continue
        assert status["mode"] == "active"
        resource.prlimit(robot.process.pid, resource.RLIMIT_NOFILE, before)
        assert local.ask("status")["mode"] == "active"
        assert tell("status", at)["mode"] == "active"
        robot.end(signal.SIGTERM)
        assert "not whole" not in robot.stderr
        assert_no_traceback(robot)
        assert law.end(signal.SIGTERM) == 0
