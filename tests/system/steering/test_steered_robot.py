"""A running robot from Python: what it says, who steers it, and what an operator's end leads to."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from support.command_bench import (
    PATIENT,
    QUIET,
    Command,
    controller,
    emulator,
    endpoint,
    events,
    wait_for_mode,
)

import hoap3
from hoap3.protocol.errors import BadProblemError, LinkError, UsageError
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.tools.logs.log import Log
from hoap3.tools.replay import replay
from hoap3.tools.services.connection import Connection

pytestmark = pytest.mark.slow

ROBOT = "ur5"
EXAMPLE = Path(__file__).parents[3] / "examples" / "slow_policy.py"
HOLDER = """
import sys, time, hoap3
with hoap3.connect("ur5", sys.argv[1]) as robot:
    robot.acquire()
    print("steers", flush=True)
    time.sleep(600)
"""
FORGETFUL = """
import sys, hoap3
robot = hoap3.connect("ur5", sys.argv[1])
robot.acquire()
robot.state(), next(robot.states()), next(robot.events(0.0), None)
"""


@pytest.fixture(scope="module")
def at() -> str:
    return endpoint()


@pytest.fixture(scope="module")
def steered(at: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Command, Path]]:
    """UR5 that is followed by `steered_ur5`; the controller, and the folder of its log."""
    log = tmp_path_factory.mktemp("steered") / "log"
    with (
        emulator(ROBOT, *QUIET, *PATIENT, at=at),
        controller("steered_ur5", "--out", log, at=at) as law,
    ):
        law.hear("following robot")
        wait_for_mode("active", at, ROBOT)
        yield law, log


def patiently(attempt: Callable[[], object]) -> None:
    """Try until it is not refused any more."""
    until = time.monotonic() + 60.0
    while True:
        try:
            attempt()
        except UsageError:
            assert time.monotonic() < until, "still refused"
        else:
            return


def hand(q: np.ndarray) -> np.ndarray:
    """Where the hand is, (3,) [m]."""
    robot = hoap3.load_robot(ROBOT)
    kinematics = Kinematics(robot)
    kinematics.update(q)
    frames = kinematics.frame_id("tool0"), kinematics.frame_id(robot.base_frame)
    place = np.zeros(3)
    kinematics.frame(*frames, place, np.zeros((3, 3)), np.zeros((6, robot.n)))
    return place


def test_it_says_what_it_does(steered, at):
    with hoap3.connect(ROBOT, at) as robot:
        assert robot.description.n == 6
        assert robot.status()["mode"] == "active"
        ticks = [state.tick for state in islice(robot.states(), 20)]
        assert ticks == sorted(set(ticks))
        assert robot.state().tick >= ticks[-1]
        assert "priorities" in robot.changeable()


def test_its_numbers_change_by_key_or_by_name(steered, at):
    with hoap3.connect(ROBOT, at) as robot:
        before = robot.changeable()
        now = robot.change({"tasks.posture.gain_per_s": 2.5}, over_s=0.01)
        assert now.keys() == before.keys()
        until = time.monotonic() + 20.0
        while robot.changeable()["tasks"]["posture"]["gain_per_s"] != 2.5:
            assert time.monotonic() < until
        with pytest.raises(UsageError, match="regularisation: should be greater"):
            robot.change(regularisation=-1.0)


def test_a_target_outside_its_limits_is_an_error_and_one_inside_is_waited_for(steered, at):
    with hoap3.connect(ROBOT, at) as robot:
        robot.acquire()
        with pytest.raises(BadProblemError, match="x is 9"):
            robot.send_target([9.0, -0.15, 0.35])
        place = np.array([-0.45, -0.12, 0.4])
        robot.send_target(place)
        assert not robot.wait_until_reached(0.0)
        assert robot.wait_until_reached(30.0)
        found = robot.frame_pose("tool0")
        np.testing.assert_allclose(found[:3], place, atol=1e-3)
        np.testing.assert_allclose(found[:3], hand(robot.state().q), atol=1e-4)
        assert np.linalg.norm(found[3:]) == pytest.approx(1.0)
        with pytest.raises(hoap3.FrameNotFoundError, match="tool0"):
            robot.frame_pose("tool")
        assert "mode=ACTIVE" in repr(robot.state())


def test_a_target_is_reached(steered, at):
    aim = np.array([-0.5, -0.15, 0.35])
    with hoap3.connect(ROBOT, at) as robot:
        (target,) = robot.acquire()
        assert (target["name"], target["dimension"]) == ("hand", 3)
        assert robot.send_target(aim) == 1
        for state in islice(robot.states(), 20_000):
            if np.linalg.norm(hand(state.q) - aim) < 1e-3:
                break
        else:
            pytest.fail("it never came there")


def test_wrong_targets_are_refused_before_they_are_sent(steered, at):
    with hoap3.connect(ROBOT, at) as robot:
        patiently(robot.acquire)
        for wrong in ([1.0, 2.0], [[1.0, 2.0, 3.0]], [np.nan, 0.0, 0.0], "hello"):
            with pytest.raises(BadProblemError):
                robot.send_target(wrong)
        with pytest.raises(BadProblemError):
            robot.send_chunk(np.zeros((400, 3)), 0, 1)
        with pytest.raises(UsageError, match="hand"):
            robot.send_target([0.0, 0.0, 0.0], target="foot")


def test_what_was_refused_can_be_asked_for(steered, at):
    with hoap3.connect(ROBOT, at) as robot:
        patiently(robot.acquire)
        before = robot.counts()["refused"].get("too_far_ahead", 0)
        robot.send_target([-0.5, -0.15, 0.35], first_tick=robot.state().tick + 1_000_000)
        patiently(lambda: assert_counted(robot, before + 1))


def assert_counted(robot: Connection, times: int) -> None:
    """Raise what `patiently` waits for until it is counted."""
    if robot.counts()["refused"].get("too_far_ahead", 0) < times:
        raise UsageError("not yet")


def keep_sending(robot: Connection) -> None:
    """As a teleoperator does, until something is raised."""
    for _ in range(600):
        robot.send_target([-0.5, -0.15, 0.35])
        time.sleep(0.01)


def test_who_steers_no_longer_is_told(steered, at):
    with hoap3.connect(ROBOT, at) as first, hoap3.connect(ROBOT, at) as second:
        patiently(first.acquire)
        first._control("release")  # as if its lease had gone while it froze
        patiently(second.acquire)
        with pytest.raises(UsageError, match=second.who):
            keep_sending(first)


def test_a_robot_that_stands_still_is_not_steered_in_silence(steered, at):
    with hoap3.connect(ROBOT, at) as robot:
        patiently(robot.acquire)
        robot.stop()
        wait_for_mode("stopped", at, ROBOT)
        with pytest.raises(UsageError, match="recover"):
            keep_sending(robot)
        robot.recover()
        wait_for_mode("active", at, ROBOT)
        patiently(lambda: robot.send_target([-0.5, -0.15, 0.35]))


def test_a_closed_connection_says_that_it_is(steered, at):
    with hoap3.connect(ROBOT, at) as robot:
        pass
    for use in (robot.state, robot.status, robot.acquire, lambda: next(robot.events())):
        with pytest.raises(LinkError, match="closed"):
            use()
    robot.close()


def test_one_steers_at_a_time_and_the_next_when_it_gives_up(steered, at):
    with hoap3.connect(ROBOT, at) as first, hoap3.connect(ROBOT, at) as second:
        patiently(first.acquire)
        with pytest.raises(UsageError, match=first.who):
            second.acquire()
        first.release()
        second.acquire()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_an_operator_that_is_killed_or_freezes_makes_way(number, steered, at):
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, at], stdout=subprocess.PIPE, text=True
    ) as holder:
        try:
            assert holder.stdout is not None
            assert holder.stdout.readline() == "steers\n"
            os.kill(holder.pid, number)
            with hoap3.connect(ROBOT, at) as robot:
                since = robot.state().tick
                patiently(robot.acquire)
                print(f"{number.name}: {robot.state().tick - since} ticks until the next steers")
        finally:
            holder.kill()


def test_a_script_that_forgets_to_close_ends_and_makes_way(steered, at):
    subprocess.run([sys.executable, "-c", FORGETFUL, at], check=True, timeout=60.0)
    with hoap3.connect(ROBOT, at) as robot:
        patiently(robot.acquire)


def test_a_stop_and_a_recovery_by_somebody_who_does_not_steer(steered, at):
    with hoap3.connect(ROBOT, at) as robot:
        robot.stop()
        assert robot.status()["stop_reason"] == "command"
        wait_for_mode("stopped", at, ROBOT)
        seen = robot.events(timeout_s=1.0)
        robot.recover()
        wait_for_mode("active", at, ROBOT)
        assert "RECOVERED" in [each["event"] for each in seen] or robot.status()["mode"] == "active"


def test_the_same_for_asyncio(steered, at):
    async def story() -> int:
        async with hoap3.connect_async(ROBOT, at) as robot:
            assert (await robot.status())["mode"] == "active"
            async for state in robot.states():
                return int(state.tick)
        return 0

    assert asyncio.run(story()) > 0


def test_events_for_asyncio(steered, at):
    async def story() -> bool:
        async with hoap3.connect_async(ROBOT, at) as robot:
            await anext(robot.events(timeout_s=0.1), None)  # from now on they are kept
            await robot.stop()
            async for each in robot.events(timeout_s=10.0):
                if each["event"] == "AT_REST":
                    break
            else:
                return False
            await robot.recover()
            return True

    assert asyncio.run(story())
    wait_for_mode("active", at, ROBOT)


def test_who_released_does_not_steer(steered, at):
    with hoap3.connect(ROBOT, at) as robot:
        patiently(robot.acquire)
        robot.release()
        with pytest.raises(UsageError, match=r"acquire\(\)"):
            robot.send_target([-0.5, -0.15, 0.35])


def test_the_slow_policy_of_the_examples_steers_it(steered, at):
    words = [sys.executable, str(EXAMPLE), "--connect", at, "--seconds", "5"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert "'refused': {}" in done.stdout
    assert int(done.stdout.splitlines()[-1].split()[0]) > 50


def test_a_robot_that_is_not_there_is_said_to_be():
    with pytest.raises(LinkError, match="nothing answers"):
        hoap3.connect(ROBOT, endpoint())
    with pytest.raises(UsageError):
        hoap3.connect("*", endpoint())


def test_what_was_steered_is_in_the_log_and_repeated(steered):
    law, folder = steered
    assert law.end(2) == 0
    log = Log.open(folder, "controller")
    assert "CONTROLLER_FAILED" not in [name for name, _ in events(log)]
    again = replay(folder, [])
    assert again.identical, str(again)
