"""A running robot from Python: what it tells, who steers it, what an operator's end leads to."""

from __future__ import annotations

import asyncio
import os
import re
import runpy
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import HOUSE
from support.command_bench import (
    PATIENT,
    Command,
    endpoint,
    events,
    followed,
    inside,
    wait_for_mode,
)
from support.pages.steered_arm import tool
from support.robots.steered_hand import MOVING, hands, lag_and_error, peak_jerk

import hoap3
from hoap3.protocol.errors import BadProblemError, LinkError, UsageError
from hoap3.protocol.messages import State, Target
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis.replay import replay
from hoap3.tools.logs.log import Log, Rows
from hoap3.tools.services.connection import Connection
from hoap3.tools.verify.verify import verify

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
    with followed(at, (ROBOT, "steered_ur5"), law=("--out", log)) as (_, law):
        wait_for_mode("active", at, ROBOT)
        yield law, log


@pytest.fixture
def robot(steered: tuple[Command, Path], at: str) -> Iterator[Connection]:
    with hoap3.connect(ROBOT, at) as connected:
        yield connected


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


def test_it_says_what_it_does(robot, at):
    assert robot.description.n == 6
    assert robot.status()["mode"] == "active"
    ticks = [state.tick for state in islice(robot.states(), 20)]
    assert ticks == sorted(set(ticks))
    assert robot.state().tick >= ticks[-1]
    assert "priorities" in robot.changeable()


def test_its_numbers_change_by_key_or_by_name(robot, at):
    before = robot.changeable()
    now = robot.change({"tasks.posture.gain_per_s": 2.5}, over_s=0.01)
    assert now.keys() == before.keys()
    until = time.monotonic() + 20.0
    while robot.changeable()["tasks"]["posture"]["gain_per_s"] != 2.5:
        assert time.monotonic() < until
    with pytest.raises(UsageError, match="regularisation"):
        robot.change(regularisation=-1.0)


def test_a_target_outside_its_limits_is_an_error_and_one_inside_is_waited_for(robot, at):
    (target,) = robot.acquire()
    assert (target["name"], target["dimension"]) == ("hand", 3)
    with pytest.raises(BadProblemError, match=r"x.*9"):
        robot.send_target([9.0, -0.15, 0.35])
    place = np.array([-0.45, -0.12, 0.4])
    assert robot.send_target(place) == 1
    assert not robot.wait_until_reached(0.0)
    assert robot.wait_until_reached(30.0)
    found = robot.frame_pose("tool0")
    np.testing.assert_allclose(found[:3], place, atol=1e-3)
    np.testing.assert_allclose(found[:3], tool(robot.state().q)[:3, 3], atol=1e-4)
    assert np.linalg.norm(found[3:]) == pytest.approx(1.0)
    with pytest.raises(hoap3.FrameNotFoundError, match="'tool0'"):
        robot.frame_pose("tool")
    assert "mode=ACTIVE" in repr(robot.state())


def test_wrong_targets_are_refused_before_they_are_sent(robot, at):
    patiently(robot.acquire)
    for wrong in ([1.0, 2.0], [[1.0, 2.0, 3.0]], [np.nan, 0.0, 0.0], "hello"):
        with pytest.raises(BadProblemError):
            robot.send_target(wrong)
    with pytest.raises(BadProblemError):
        robot.send_chunk(np.zeros((400, 3)), 0, 1)
    with pytest.raises(UsageError, match="hand"):
        robot.send_target([0.0, 0.0, 0.0], target="foot")


def test_what_was_refused_can_be_asked_for(robot, at):
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
        first.control("release")  # as if its lease had gone while it froze
        patiently(second.acquire)
        with pytest.raises(UsageError, match=second.who):
            keep_sending(first)


def test_a_robot_that_stands_still_is_not_steered_in_silence(robot, at):
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
        with pytest.raises(LinkError):
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
    words = [sys.executable, "-c", HOLDER, at]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as holder:
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


def test_a_stop_and_a_recovery_by_somebody_who_does_not_steer(robot, at):
    robot.stop()
    assert robot.status()["stop_reason"] == "command"
    wait_for_mode("stopped", at, ROBOT)
    seen = robot.events(timeout_s=1.0)
    robot.recover()
    wait_for_mode("active", at, ROBOT)
    assert "RECOVERED" in [each["event"] for each in seen] or robot.status()["mode"] == "active"


def test_it_works_from_asyncio(steered, at):
    async def story() -> int:
        with await asyncio.to_thread(hoap3.connect, ROBOT, at) as robot:
            return int((await asyncio.to_thread(robot.state)).tick)

    assert asyncio.run(story()) > 0


def test_who_released_does_not_steer(robot, at):
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
    with pytest.raises(LinkError, match="tcp/"):
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


PAGE = HOUSE / "docs" / "guides" / "live.md"
DOWN = Rotation.from_quat([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])
AIM = Rotation.from_rotvec([0.0, 0.4, 0.0]) * DOWN
PLACE = np.array([-0.5, -0.15, 0.35])


@pytest.fixture(scope="module")
def pose_at() -> str:
    return endpoint()


@pytest.fixture(scope="module")
def posed(pose_at: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Command, Path]]:
    """UR5 that follows the page's config; the controller, and the folder of its log."""
    folder = tmp_path_factory.mktemp("posed")
    config, log = folder / "pose.yaml", folder / "log"
    text = PAGE.read_text(encoding="utf-8")
    found = re.search(r"<!-- file: pose.yaml -->\n```yaml\n(.*?)```", text, re.DOTALL)
    assert found is not None
    config.write_text(found[1].replace("5.0", "60.0"), encoding="utf-8")
    with followed(pose_at, (ROBOT, config), law=("--out", log)) as (_, law):
        wait_for_mode("active", pose_at, ROBOT)
        yield law, log


def off(q: np.ndarray) -> tuple[float, float]:
    """How far the tool is from where it shall be [m], and turned [rad]."""
    found = tool(q)
    away = Rotation.from_matrix(found[:3, :3]) * AIM.inv()
    return float(np.linalg.norm(found[:3, 3] - PLACE)), float(away.magnitude())


def test_a_pose_is_reached(posed, pose_at):
    with hoap3.connect(ROBOT, pose_at) as robot:
        (target,) = robot.acquire(timeout_s=60.0)
        assert target["layout"] == ["x", "y", "z", "qx", "qy", "qz", "qw"]
        assert (target["dimension"], target["rates"]) == (7, 6)
        for _ in range(5):  # a busy machine takes the lease from whoever renews it too late
            robot.send_target([*PLACE, *AIM.as_quat()])
            if any(max(off(state.q)) < 1e-3 for state in islice(robot.states(), 1_000)):
                break
            robot.acquire(timeout_s=60.0)
        else:
            pytest.fail(f"it never came there: {robot.status()}, {robot.counts()}")
        assert robot.counts()["taken"] >= 1


def test_a_chunk_of_poses_has_rates_of_six_numbers(posed, pose_at):
    with hoap3.connect(ROBOT, pose_at) as robot:
        robot.acquire(timeout_s=60.0)
        points, rates = np.tile([*PLACE, *AIM.as_quat()], (5, 1)), np.zeros((5, 6))
        robot.send_chunk(points, robot.state().tick, 50, rates)
        with pytest.raises(BadProblemError, match=r"\(5, 6\)"):
            robot.send_chunk(points, robot.state().tick, 50, np.zeros((5, 7)))
        with pytest.raises(BadProblemError, match=r"\(p, 7\)"):
            robot.send_target(PLACE)
        robot.send_target([*PLACE, 0.0, 0.0, 0.0, 0.5])
        for _ in islice(robot.states(), 20):
            pass
        counts = robot.counts()
        assert (counts["taken"], counts["refused"]) == (1, {"not_unit": 1})


def test_its_log_is_repeated_and_true(posed):
    law, folder = posed
    assert law.end(2) == 0
    again = replay(folder, [])
    assert again.identical, str(again)
    found = verify(folder)
    assert found.claims.by_tick() == []
    open_ = {name for name, one in found.claims.as_json()["claims"].items() if one["unverified"]}
    assert open_ == {"both logs"}  # the robot keeps none here


CENTRE = np.array([-0.55, -0.11, 0.3])
SECONDS = 60


@pytest.mark.long
def test_a_minute_of_chunks_over_the_network(tmp_path: Path) -> None:
    """Limits at every tick, no stop, no lag, little jerk; `verify` and `replay` agree."""
    at, folder = endpoint(), tmp_path / "run"
    out = "--out", folder
    with followed(at, (ROBOT, "steered_ur5"), robot=(*out, *PATIENT), law=out) as (robot, law):
        wait_for_mode("active", at, "ur5")
        words = [sys.executable, str(EXAMPLE), "--connect", at, "--seconds", str(SECONDS)]
        policy = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
        assert policy.returncode == 0, policy.stderr
        assert law.end(2) == 0
        robot.end(2)
    print(policy.stdout)
    assert "'refused': {}" in policy.stdout
    assert_followed(Log.open(folder, "robot").states(), chunks(folder))
    assert replay(folder, []).identical
    told = inside("verify", folder)
    print(told.stdout)
    assert told.code == 0


def chunks(folder: Path) -> list[tuple[int, np.ndarray]]:
    """When each chunk was taken, and the point that it then has for the next period."""
    found, tick = [], 0
    for record in Log.open(folder, "controller").records():
        if record.kind == Kind.STATE:
            (tick,) = State.scalars(record.payload, "tick")
        elif record.kind == Kind.TARGET:
            made = Target.like(record.payload)
            made.load(record.payload)
            points = made.values.reshape(made.points, made.dimension).copy()
            found.append((tick, points[-(-(tick - made.first_tick) // made.tick_step)]))
    return found


def assert_followed(states: Rows, taken: list[tuple[int, np.ndarray]]) -> None:
    """What the robot did while it was steered; `taken` says what holding would have done."""
    robot = hoap3.load_robot("ur5")
    first, last = taken[0][0], taken[-1][0]
    states = states[(states["tick"] >= first) & (states["tick"] <= last)]
    assert (states["mode"] == State.ACTIVE).all()
    assert (np.abs(states["reference_rate"]) <= robot.velocity * (1 + 1e-9)).all()
    most = robot.setpoint_acceleration_max
    assert (np.abs(states["reference_acceleration"]) <= most * (1 + 1e-9) + 1e-7).all()
    ticks, path = states["tick"].astype(int), hands(states["q"])
    policy = runpy.run_path(str(EXAMPLE))["Policy"](CENTRE)
    lag, error = lag_and_error(path, ticks, policy.place)
    naive = np.zeros_like(path)
    for tick, place in taken:
        naive[ticks >= tick] = place
    jerk, naive_jerk = (peak_jerk(each[MOVING], ticks[MOVING]) for each in (path, naive))
    print(
        f"{len(states)} States of {last - first + 1}, {len(taken)} chunks: lag {lag} ms, "
        f"RMS {1e3 * error:.4f} mm, jerk {jerk:.3g} against {naive_jerk:.3g} m/s^3"
    )
    assert lag <= 20
    assert error <= 2e-3
    assert jerk <= 0.1 * naive_jerk
