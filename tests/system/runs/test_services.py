"""The two services as they live and die: who commands, who waits, who stops, and how it goes on."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest
from support.certificates.laboratory import laboratory
from support.command_bench import (
    PATIENT,
    QUIET,
    Command,
    assert_at_rest,
    assert_no_traceback,
    controller,
    emulator,
    endpoint,
    events,
    followed,
    following,
    hoap3,
    inside,
    tell,
    wait_for_mode,
)

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_link import ZenohControllerLink
from hoap3.protocol.messages import State
from hoap3.robot_emulator.robots import load
from hoap3.tools.logs.log import Log

pytestmark = pytest.mark.slow

THRESHOLD = 500  # misses: many for a busy machine, and reached before the lease of 1 s ends


@pytest.fixture(scope="module")
def at() -> str:
    return endpoint()


@pytest.fixture(scope="module")
def robot(at: str) -> Iterator[Command]:
    """One robot for all that can share it; each test leaves it idle."""
    with emulator("hoap3", *QUIET, *PATIENT, at=at) as command:
        yield command
        assert command.end(signal.SIGTERM) in {0, 1}  # 1: there were safe stops
        assert_no_traceback(command)
        command.assert_no_orphan()


def test_one_controller_commands_until_it_gives_authority_back(robot, at):
    with controller("qp12", *QUIET, at=at) as first:
        first.wait_for("following robot")
        holder = wait_for_mode("active", at)["holder"]
        assert str(first.process.pid) in holder
        with controller("pinv", *QUIET, at=at) as second:
            assert second.end() == 1
        (error,) = [line for line in second.stderr.splitlines() if line.startswith("error:")]
        assert f"{holder!r}" in error
        robot.wait_for(r"refused \(epoch \d+ holds it\)")
        assert tell("status", at)["holder"] == holder
        assert_stop_latches_until_recover(robot, first, at)
        assert first.end(signal.SIGTERM) == 0
        assert_no_traceback(first)
        first.assert_no_orphan()
    robot.wait_for(r"braking \(released\)")
    assert wait_for_mode("idle", at)["holder"] is None
    with following("pinv", *QUIET, at=at) as next_one:  # without `recover`
        assert next_one.end(signal.SIGTERM) == 0
    wait_for_mode("idle", at)


def assert_stop_latches_until_recover(robot: Command, law: Command, at: str) -> None:
    assert tell("stop", at)["mode"] in {"stopping", "stopped"}
    robot.wait_for(r"braking \(command\)")
    law.wait_for("waits to be recovered")
    wait_for_mode("stopped", at)
    again = hoap3("recover", "--connect", at)
    assert again.end() == 0
    assert again.stdout.startswith("hoap3: ")
    wait_for_mode("active", at)
    assert inside("recover", "--connect", at).code == 1  # nothing was latched


def test_the_name_of_a_client_does_not_steer_the_terminal(robot, at):
    name = "\x1b]0;mine\x07\x1b[2J"
    link = ZenohControllerLink("hoap3", LinkSettings(connect=(at,)), name)
    with closing(link):
        while tell("status", at)["holder"] != name:  # until the robot sees the token
            link.ask("acquire")
        done = inside("status", "--connect", at)
        assert "follows \\x1b]0;mine\\x07\\x1b[2J" in done.stdout
        assert done.stdout.replace("\n", "").isprintable()
        link.ask("release")
    wait_for_mode("idle", at)
    assert "\x1b" not in robot.stderr


@pytest.mark.long
def test_a_second_robot_of_the_name_is_refused(robot, at):
    ports = hoap3("emulator", "hoap3", *QUIET, "--set", f"link.listen=[{at}]")
    linked = ("--set", f"link.listen=[{endpoint()}]", "--set", f"link.connect=[{at}]")
    names = hoap3("emulator", "hoap3", *QUIET, *linked)
    for refused, words in ((ports, at), (names, "'hoap3'")):
        assert refused.end() == 2
        assert_no_traceback(refused)
        (error,) = [line for line in refused.stderr.splitlines() if line.startswith("error:")]
        assert words in error
    assert tell("status", at)["mode"] == "idle"


def test_a_frozen_controller_is_stopped_after_so_many_misses(tmp_path):
    """First the misses count; a lease later its authority is gone; then it asks anew."""
    at, out = endpoint(), tmp_path / "robot"
    with followed(at, robot=("--set", f"misses_to_stop={THRESHOLD}", "--out", out)) as (robot, law):
        wait_for_mode("active", at)
        law.send(signal.SIGSTOP)
        robot.wait_for(r"safe stop \(misses\)")
        robot.wait_for(r"holder lost \(epoch \d+\)")
        assert tell("status", at)["holder"] is None
        law.send(signal.SIGCONT)
        law.wait_for(rf"following robot .*`hoap3 recover hoap3 --connect {at}`")
        status = tell("status", at)
        assert (status["mode"], status["stop_reason"]) == ("stopped", "misses")
        assert tell("recover", at)["recovered"]
        wait_for_mode("active", at)
        assert law.end(signal.SIGTERM) == 0
        wait_for_mode("idle", at)
        assert robot.end(signal.SIGTERM) == 1  # there was a safe stop
    log = Log.open(out, side="robot")
    assert ("SAFE_STOP", 1) in events(log)
    states = log.states()
    active = states["mode"] == State.ACTIVE
    first = int(np.argmax(active))
    last = first + int(np.argmin(active[first:]))  # it stands still: no need to brake
    assert states["mode"][last] == State.STOPPED
    misses = (states["late"] + states["lost"])[first : last + 1]
    assert misses[-1] - misses[-1 - THRESHOLD] == THRESHOLD
    assert misses[-1 - THRESHOLD] == misses[-2 - THRESHOLD]  # the one before was in time


def test_a_killed_controller_and_its_successor(tmp_path):
    """Misses are counted, the stop latches, nothing jumps, neither then nor after `recover`."""
    at, out = endpoint(), tmp_path / "robot"
    nowhere = ("--set", "realtime.watch_stalls=[1023]")
    with emulator("hoap3", *PATIENT, *nowhere, "--out", out, at=at) as robot:
        robot.wait_for("CPU 1023: stalls are not watched, which takes SCHED_FIFO 99")
        with following("qp12_paper", *QUIET, at=at) as first:
            assert first.end(signal.SIGKILL) == -signal.SIGKILL
            robot.wait_for(r"safe stop \((misses|holder lost)\)")
            status = wait_for_mode("stopped", at)
            first.assert_no_orphan()
        with controller("qp12_paper", *QUIET, at=at) as second:
            second.wait_for("following robot")
            status = tell("status", at)
            assert str(second.process.pid) in status["holder"]
            assert status["mode"] == "stopped"
            tick = tell("recover", at)["tick"]
            while wait_for_mode("active", at)["tick"] < tick + 100:
                continue
            assert second.end(signal.SIGTERM) == 0
        wait_for_mode("idle", at)
        assert robot.end(signal.SIGTERM) == 1  # there was a safe stop
        assert_no_traceback(robot)
    log = Log.open(out, side="robot")
    assert_at_rest(log)
    kinds = [name for name, _ in events(log)]
    order = ["GRANTED", "SAFE_STOP", "AT_REST", "GRANTED", "RECOVERED", "RELEASED", "ENDED"]
    places = [kinds.index("GRANTED")]
    for kind in order[1:]:
        places.append(kinds.index(kind, places[-1] + 1))
    assert_nothing_jumps(log)


def assert_nothing_jumps(log: Log) -> None:
    """Velocity within its limits; changes of it within those of the first start, or of braking."""
    description, states = load("hoap3"), log.states()
    moved = np.diff(states["reference"], axis=0)
    rate = moved / description.period_s
    assert (np.abs(moved) <= description.velocity * description.period_s * (1 + 1e-9)).all()
    mode = states["mode"][1:]
    jump = np.diff(rate, axis=0, prepend=np.zeros((1, description.n)))
    epochs = states["epoch"][1:]
    first = np.abs(rate[(mode == State.ACTIVE) & (epochs == 1)]).max()
    again = np.abs(jump[(mode == State.ACTIVE) & (epochs == 2)])
    assert first > 0
    assert again.max() > 0  # it did go on
    assert again.max() <= 1.1 * first
    braking = np.abs(jump[mode == State.STOPPING])
    assert (braking <= description.brake_acceleration * description.period_s * (1 + 1e-6)).all()
    assert not rate[(mode == State.STOPPED) | (mode == State.IDLE)].any()


def test_a_controller_that_a_robot_does_not_list_says_so_while_it_waits(tmp_path):
    at = endpoint().replace("tcp/", "tls/")
    laboratory(tmp_path, "hoap3")
    (tmp_path / "hoap3" / "access.yaml").write_text("controllers: []\n", encoding="utf-8")
    with (
        emulator("hoap3", *QUIET, "--secure", tmp_path / "hoap3", at=at),
        controller("qp12", *QUIET, "--secure", tmp_path / "qp", at=at) as law,
    ):
        law.wait_for(r"waiting for robot 'hoap3'.*access\.yaml must list 'qp' as controller")
        assert law.end(signal.SIGTERM) == 0


def test_the_controller_waits_for_its_robot_and_for_its_return():
    at = endpoint()
    with controller("qp12", *QUIET, at=at) as law:
        law.wait_for("waiting for robot 'hoap3'")
        with emulator("hoap3", *QUIET, *PATIENT, at=at) as first:
            law.wait_for("following robot")
            wait_for_mode("active", at)
            assert first.end(signal.SIGKILL) == -signal.SIGKILL
            first.assert_no_orphan()
            law.wait_for("robot 'hoap3' is gone")
            law.wait_for("waiting for robot 'hoap3'", 2)
        with emulator("hoap3", *QUIET, *PATIENT, at=at) as second:
            law.wait_for("following robot", 2)
            wait_for_mode("active", at)
            assert law.end(signal.SIGTERM) == 0
            wait_for_mode("idle", at)
            assert second.end(signal.SIGTERM) in {
                0,
                1,
            }  # how fit this machine is, is another matter
        assert_no_traceback(law)
