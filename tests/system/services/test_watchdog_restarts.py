"""Services under a watchdog, with a test in systemd's place: it hears, ends and restarts them.

What systemd itself does is not tested here; the units are what tells it.
"""

from __future__ import annotations

import os
import signal

import pytest
from support.command_bench import (
    PATIENT,
    QUIET,
    Command,
    assert_no_traceback,
    controller,
    emulator,
    endpoint,
    observer_of,
    tell,
    wait_for_mode,
)
from support.systemd.stand_in import SystemdStandIn

from hoap3.tools.logs.log import Log

pytestmark = pytest.mark.slow

WATCHDOG_S = 3.0  # a busy machine may not run an observer for a second


def under(systemd: SystemdStandIn) -> dict[str, str]:
    return systemd.environment(WATCHDOG_S)


def kill_as_systemd_does(service: Command) -> None:
    """WatchdogSignal=SIGKILL, KillMode=mixed."""
    for pid in (service.process.pid, *service.family()):
        os.kill(pid, signal.SIGKILL)
    service.process.wait()


def test_a_controller_that_stalls_is_ended_and_restarted_while_its_robot_rests(tmp_path):
    at = endpoint()
    with (
        SystemdStandIn(tmp_path / "notify") as systemd,
        emulator("hoap3", *QUIET, "--set", "misses_to_stop=50", at=at) as robot,
    ):
        with controller("qp12", *QUIET, at=at, environment=under(systemd)) as law:
            law.wait_for("following robot")
            assert systemd.wait_for(lambda: systemd.count("READY=1") == 1)
            systemd.wait_for_more("WATCHDOG=1", 3)
            law.send(signal.SIGSTOP)  # its loop hangs; its observer does not
            systemd.wait_for_silence("WATCHDOG=1", WATCHDOG_S)
            assert tell("status", at)["mode"] == "stopped"  # long since
            kill_as_systemd_does(law)
        with controller("qp12", *QUIET, at=at, environment=under(systemd)) as law:
            law.wait_for("which does not move")  # the stop is latched
            systemd.wait_for_more("WATCHDOG=1", 2)
            tell("recover", at)
            wait_for_mode("active", at)
            assert law.end(signal.SIGTERM) == 0
            assert systemd.wait_for(lambda: "STOPPING=1" in systemd.heard)
            assert_no_traceback(law)
        assert robot.end(signal.SIGTERM) == 1  # there was a safe stop


def test_a_robot_that_stalls_is_ended_and_restarted_and_followed_again(tmp_path):
    at = endpoint()
    with (
        SystemdStandIn(tmp_path / "notify") as systemd,
        controller("qp12", *QUIET, at=at) as law,
    ):
        with emulator("hoap3", *QUIET, *PATIENT, at=at, environment=under(systemd)) as robot:
            law.wait_for("following robot")
            assert systemd.wait_for(lambda: systemd.count("READY=1") == 1)
            systemd.wait_for_more("WATCHDOG=1", 3)
            assert systemd.wait_for(
                lambda: any(line.startswith("STATUS=") for line in systemd.heard)
            )
            robot.send(signal.SIGSTOP)
            systemd.wait_for_silence("WATCHDOG=1", WATCHDOG_S)
            kill_as_systemd_does(robot)
        with emulator("hoap3", *QUIET, *PATIENT, at=at, environment=under(systemd)) as robot:
            law.wait_for("following robot", times=2)
            systemd.wait_for_more("WATCHDOG=1", 2)
            robot.end(signal.SIGTERM)
            assert_no_traceback(robot)
        assert law.end(signal.SIGTERM) == 0


def test_a_service_whose_observer_was_killed_is_still_pinged_for(tmp_path):
    at, out = endpoint(), tmp_path / "log"
    with (
        SystemdStandIn(tmp_path / "notify") as systemd,
        emulator("hoap3", *PATIENT, "--out", out, at=at, environment=under(systemd)) as robot,
    ):
        systemd.wait_for_more("WATCHDOG=1", 2)
        os.kill(observer_of(robot), signal.SIGKILL)
        robot.wait_for("its observer was killed by signal 9")
        systemd.wait_for_more("WATCHDOG=1", 8)
        robot.send(signal.SIGSTOP)
        systemd.wait_for_silence("WATCHDOG=1", WATCHDOG_S)
        robot.send(signal.SIGCONT)
        systemd.wait_for_more("WATCHDOG=1")
        assert robot.end(signal.SIGTERM) == 1
    assert Log.open(out).truncated
