"""The bridges as commands, beside a robot and its controller that run."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
import pytest
from foxglove_client import FoxgloveClient
from looked_at import assert_ends, assert_shows_joints, until
from support.command_bench import QUIET, Command, emulator, endpoint, followed, wait_for_mode

import hoap3
from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import State
from hoap3.remote_controller.model.kinematics import Kinematics

pytestmark = pytest.mark.slow

ROBOT = "ur5"
STATES = f"/robots/{ROBOT}/state"
POINT = "geometry_msgs/PointStamped"
PLACE = np.array([-0.5, -0.15, 0.35])
ELSEWHERE = np.array([-0.55, -0.05, 0.35])


@pytest.fixture(scope="module")
def at() -> Iterator[str]:
    """Where UR5 listens, which follows a controller with a live target."""
    place = endpoint()
    with followed(place, (ROBOT, "steered_ur5")):
        wait_for_mode("active", place, ROBOT)
        yield place


@contextmanager
def bridge(at: str, *words: str) -> Iterator[int]:
    """`hoap3 bridge foxglove` of the robot; its port."""
    with Command("bridge", "foxglove", ROBOT, "--connect", at, "--port", 0, *words) as command:
        found = command.wait_for(r"ws://127\.0\.0\.1:(\d+)")
        yield int(found[1])
        assert_ends(command, signal.SIGINT)


def clicked(place: np.ndarray, frame: str = "world") -> dict[str, Any]:
    """What the panel publishes."""
    point = dict(zip("xyz", place.tolist(), strict=True))
    stamp = {"sec": 0, "nsec": 0}
    return {"header": {"frame_id": frame, "stamp": stamp}, "point": point}


def off(client: FoxgloveClient, place: np.ndarray) -> float:
    """How far the tool is from where it shall be [m]."""
    place_now, turn, jacobian = np.zeros(3), np.zeros((3, 3)), np.zeros((6, 6))
    kinematics, frames = tool()
    kinematics.update(np.array(client.decoded_newest(STATES).q))
    kinematics.frame(*frames, place_now, turn, jacobian)
    return float(np.linalg.norm(place_now - place))


@cache
def tool() -> tuple[Kinematics, tuple[int, int]]:
    """UR5's kinematics, and its tool as seen from its base."""
    robot = hoap3.load_robot(ROBOT)
    kinematics = Kinematics(robot)
    return kinematics, (kinematics.frame_id("tool0"), kinematics.frame_id(robot.base_frame))


def test_a_client_that_publishes_moves_nothing_without_steer_and_the_tool_with_it(at: str) -> None:
    with bridge(at) as port, FoxgloveClient(port) as client:
        client.look_at_all()
        client.wait_for(lambda: client.messages.get(f"/robots/{ROBOT}/setpoint"))
        began = np.array(client.decoded_newest(STATES).q)
        client.advertise("/clicked_point", POINT)
        for _ in range(3):
            client.publish(clicked(PLACE))
        client.wait_for(lambda: any("clientPublish" in each for each in client.status))
        seen = len(client.messages[STATES])
        client.wait_for(lambda: len(client.messages[STATES]) > seen + 60)
        assert np.abs(np.array(client.decoded_newest(STATES).q) - began).max() < 1e-4
    with bridge(at, "--steer") as port, FoxgloveClient(port) as client:
        client.look_at_all()
        client.wait_for(lambda: client.messages.get(STATES))
        assert off(client, PLACE) > 0.02
        client.advertise("/clicked_point", POINT)
        client.publish(clicked(ELSEWHERE, "wrist_3_link"))
        client.wait_for(lambda: any("wrist_3_link" in each for each in client.status))
        client.publish(clicked(PLACE))
        client.wait_for(lambda: off(client, PLACE) < 1e-3)
        with hoap3.connect(ROBOT, at) as other, pytest.raises(UsageError):
            other.acquire()
        client.drop()
        with hoap3.connect(ROBOT, at) as other:
            until(lambda: acquires(other))
            assert other.counts()["refused"] == {}


def acquires(robot: Any) -> bool:
    """Whether it may steer now."""
    try:
        robot.acquire()
    except UsageError:
        return False
    return True


def test_no_more_than_100_states_a_second_are_shown(at: str) -> None:
    with bridge(at) as port, FoxgloveClient(port) as client:
        client.look_at_all()
        client.wait_for(lambda: len(client.messages.get(STATES, ())) > 100)
    ticks = [State.scalars(payload, "tick")[0] for payload in client.messages[STATES]]
    assert len(ticks) / (ticks[-1] - ticks[0]) < 0.1  # of the robot's milliseconds


def test_ros2_sees_the_joints_of_the_robot(at: str) -> None:
    assert_shows_joints(ROBOT, "--connect", at)


@pytest.mark.long  # it needs the machine for itself
def test_a_robot_that_is_killed_and_starts_again_is_seen_again() -> None:
    place = endpoint()
    with bridge(place) as port, FoxgloveClient(port) as client:
        client.look_at_all()
        runs = []
        for _ in range(2):
            with emulator(ROBOT, *QUIET, at=place) as robot:
                client.wait_for(lambda: newest_run(client) not in {None, *runs})
                runs.append(newest_run(client))
                robot.send(signal.SIGKILL)
                robot.end()


def newest_run(client: FoxgloveClient) -> int | None:
    """Session of the newest State that was shown."""
    shown = client.messages.get(STATES)
    return None if not shown else int(State.scalars(shown[-1], "session_id")[0])
