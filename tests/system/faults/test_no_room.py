"""No room on a disk, in a folder or for descriptors, while a robot runs: it does not notice."""

from __future__ import annotations

import os
import resource
import signal
import socket
from pathlib import Path

import pytest
from mcap.reader import make_reader
from support.command_bench import (
    PATIENCE_S,
    PATIENT,
    QUIET,
    assert_no_traceback,
    controller,
    emulator,
    endpoint,
    followed,
    free_port,
    observer_of,
    tell,
    wait_for_mode,
    wait_for_ticks,
)

import hoap3
from hoap3.protocol.link.local_control import local_robots
from hoap3.tools.logs.log import Log

pytestmark = pytest.mark.slow

SMALL_FILES = ("--set", "log.file_mb=1")
MODES_COUNT = ("setpriv", "--bounding-set=-dac_override") if os.geteuid() == 0 else ()
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


def test_a_full_disk_costs_the_log_alone(tmp_path):
    at, disk = endpoint(), (*SMALL_DISK, str(tmp_path))
    words = "hoap3", *PATIENT, "--out", tmp_path / "log", "--json"
    with (
        emulator(*words, at=at, wrapper=disk) as robot,
        hoap3.connect("hoap3", at) as connection,
        controller("qp12", *QUIET, at=at) as law,
    ):
        assert "LOG_LOST" in (event["event"] for event in connection.events(PATIENCE_S))
        robot.wait_for("robot's log is not whole: No space left on device")
        robot.wait_for(r"tick \d+: log lost \(No space left on device")
        wait_for_ticks(at, 200)
        assert robot.end(signal.SIGTERM) == 1
        assert robot.stderr.count("log is not whole") == 1
        assert len(robot.json()["log_lost"]) == 1
        assert robot.json()["ticks"] > 200  # counted to the end
        assert law.end(signal.SIGTERM) == 0
        assert_no_traceback(robot)
        robot.assert_no_orphan()


def test_a_folder_that_becomes_read_only_costs_the_log_from_the_next_file_on(tmp_path):
    at, out = endpoint(), tmp_path / "log"
    words = "hoap3", *PATIENT, *SMALL_FILES, "--out", out, "--json"
    with (
        emulator(*words, at=at, wrapper=MODES_COUNT) as robot,
        hoap3.connect("hoap3", at) as connection,
        controller("qp12", *QUIET, at=at) as law,
    ):
        wait_for_mode("active", at)
        observer_of(robot, "robot.mcap", at)  # which begins when it gets a processor
        out.chmod(0o555)
        assert "LOG_LOST" in (event["event"] for event in connection.events(PATIENCE_S))
        robot.wait_for("robot's log is not whole: .*Permission denied")
        wait_for_ticks(at, 200)
        assert robot.end(signal.SIGTERM) == 1
        assert len(robot.json()["log_lost"]) == 1
        assert law.end(signal.SIGTERM) == 0
        assert_no_traceback(robot)
    out.chmod(0o755)
    assert [path.name for path in out.iterdir()] == ["robot.mcap"]
    with (out / "robot.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count > 1000


@pytest.mark.parametrize("side", ["robot", "controller"])
def test_an_observer_without_descriptors_writes_on_and_serves_who_waits(tmp_path, side):
    at, out, port = endpoint(), tmp_path / "log", free_port()
    watched = ("--out", out, *SMALL_FILES, "--set", f"metrics.port={port}")
    kept = dict.fromkeys(("robot", "controller"), QUIET) | {side: watched}
    with followed(at, robot=(*PATIENT, *kept["robot"]), law=kept["controller"]) as (robot, law):
        service = robot if side == "robot" else law
        service.wait_for("metrics at")
        wait_for_mode("active", at)
        observer = observer_of(service)
        before = use_up_descriptors(observer)
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as client:
            client.sendall(b"GET /metrics HTTP/1.0\r\n\r\n")  # nobody can take it now
            while not (out / f"{side}.0001.mcap").exists():
                wait_for_ticks(at, 200)
            resource.prlimit(observer, resource.RLIMIT_NOFILE, before)
            assert b" 200 " in client.recv(100)
        assert law.end(signal.SIGTERM) == 0
        robot.end(signal.SIGTERM)
        for each in (robot, law):
            assert "not whole" not in each.stderr
            assert_no_traceback(each)
    assert not Log.open(out, side=side).missing


def test_a_controller_without_descriptors_follows_its_robot_and_then_finds_another(tmp_path):
    at = endpoint()
    with controller("qp12", "--out", tmp_path, at=at) as law:
        with emulator("hoap3", *QUIET, *PATIENT, at=at) as robot:
            wait_for_mode("active", at)
            before = use_up_descriptors(law.process.pid)
            wait_for_ticks(at, 200)
            robot.send(signal.SIGKILL)
            robot.end()
        with emulator("hoap3", *QUIET, *PATIENT, at=at) as robot:
            resource.prlimit(law.process.pid, resource.RLIMIT_NOFILE, before)
            law.wait_for("following robot", times=2)
            wait_for_mode("active", at)
            robot.end(signal.SIGTERM)
        assert law.end(signal.SIGTERM) == 0
        assert "not whole" not in law.stderr
        assert_no_traceback(law)


def test_a_robot_without_descriptors_serves_whom_it_knows_and_then_all(tmp_path):
    at = endpoint()
    with (
        followed(at, robot=(*PATIENT, "--out", tmp_path)) as (robot, law),
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
