"""A client of Foxglove's protocol sees a robot on a real Zenoh session, and decodes all of it."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_client import FoxgloveClient
from looked_at import LookedAt, fed, until
from support.command_bench import PATIENCE_S, endpoint
from support.small_arm import arm

from hoap3.protocol.errors import ConfigError, PortInUseError
from hoap3.protocol.link import zenoh_session
from hoap3.protocol.link.zenoh_session import is_alive
from hoap3.protocol.messages import Event, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.tools.bridge import robot_feed
from hoap3.tools.bridge.foxglove_server import FoxgloveServer

ROBOT = arm()
HERE = f"/robots/{ROBOT.name}"


@pytest.fixture
def at() -> str:
    return endpoint()


@pytest.fixture
def server() -> Iterator[FoxgloveServer]:
    with closing(FoxgloveServer("127.0.0.1", 0)) as made:
        yield made


@pytest.fixture
def robot(server, at) -> Iterator[LookedAt]:
    """A robot that the server shows."""
    with LookedAt(ROBOT, at) as made, fed(server, lambda: (ROBOT.name, at)):
        yield made


@pytest.fixture
def client(server, robot) -> Iterator[FoxgloveClient]:
    """One that looks at all that the server shows of the robot."""
    with FoxgloveClient(server.port) as made:
        made.look_at_all()
        yield made


def test_a_client_lists_all_channels_and_decodes_each(robot, client):
    q = ROBOT.initial_position + 0.1
    event = Event()
    event.kind, event.tick = Event.schema.constants["RECOVERED"], 5
    topics = {f"{HERE}/{leaf}" for leaf in ("state", "setpoint", "events", "joint_states")}
    topics |= {"/robot_description", "/tf"}
    client.wait_for(lambda: client.channels.keys() >= topics)
    assert client.channels.keys() == topics

    def say() -> None:
        for message in (robot.state(q=q), robot.setpoint(), event):
            robot.say(message)

    client.wait_for(lambda: client.messages.keys() >= topics, say)
    for topic in topics:
        for decode in (client.decoded, client.decoded_by_rosbags):
            assert len(decode(topic)) == len(client.messages[topic]), topic
    assert np.array_equal(client.decoded(f"{HERE}/state")[-1].q, q)
    assert client.decoded(f"{HERE}/setpoint")[-1].v == 0.25
    assert client.decoded(f"{HERE}/events")[-1].tick == 5
    joints = client.decoded(f"{HERE}/joint_states")[-1]
    assert (tuple(joints.name), list(joints.position)) == (ROBOT.joint_names, q.tolist())
    assert client.decoded("/robot_description")[-1].data == ROBOT.urdf
    frames = client.decoded("/tf")[-1].transforms
    assert {each.child_frame_id for each in frames} == set(ROBOT.frames)


def test_states_are_the_bytes_that_the_robot_sent(robot, client):
    sent, seen = list[bytes](), client.messages.setdefault(f"{HERE}/state", [])
    client.wait_for(lambda: len(seen) > 5, lambda: sent.append(robot.say(robot.state())))
    assert set(seen) <= set(sent)


def test_who_comes_later_is_given_the_description(server, at):
    with LookedAt(ROBOT, at), fed(server, lambda: (ROBOT.name, at)) as told:
        until(lambda: told)
        for _ in range(2):
            with FoxgloveClient(server.port) as client:
                client.look_at_all()
                client.wait_for(lambda: client.messages.get("/robot_description"))


@pytest.mark.slow
def test_a_client_that_asks_for_a_channel_that_is_gone_holds_up_nobody():
    here = Path(__file__).parent
    paths = os.pathsep.join([str(here), str(here.parents[1]), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(  # apart, as a server that stands still takes its process with it
        [sys.executable, here / "late_subscriber.py"],
        env={**os.environ, "PYTHONPATH": paths},
        timeout=PATIENCE_S,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_robot_that_comes_later_and_then_as_another_one_is_seen(server, at):
    other = renamed_joint(ROBOT)
    with fed(server, lambda: (ROBOT.name, at)) as told, FoxgloveClient(server.port) as client:
        client.look_at_all()
        until(lambda: told)
        assert "waiting" in told[0]
        for session, description in ((7, ROBOT), (8, ROBOT), (9, other)):
            with LookedAt(description, at, session) as robot:
                client.wait_for(
                    partial(shows, client, robot), lambda robot=robot: robot.say(robot.state())
                )


def shows(client: FoxgloveClient, robot: LookedAt) -> bool:
    """Whether the newest that a client has is of this run of a robot."""
    topics = f"{HERE}/state", f"{HERE}/joint_states", "/robot_description"
    if not client.messages.keys() & client.channels.keys() >= set(topics):
        return False
    state, joints, text = (client.decoded_newest(topic) for topic in topics)
    wanted = robot.description
    names, urdf = wanted.joint_names, wanted.urdf
    return (state.session_id, tuple(joints.name), text.data) == (robot.session_id, names, urdf)


def test_a_robot_that_says_nothing_but_lives_is_kept(server, at, monkeypatch):
    monkeypatch.setattr(robot_feed, "SILENCE_S", -1.0)  # it is asked in each period
    asked: list[bool] = []

    def alive(*given: Any) -> bool:
        asked.append(is_alive(*given))
        return asked[-1]

    monkeypatch.setattr(zenoh_session, "is_alive", alive)
    with LookedAt(ROBOT, at), fed(server, lambda: (ROBOT.name, at)) as told:
        until(lambda: len(asked) > 5)
        assert len(told) == 1


def renamed_joint(description: RobotDescription) -> RobotDescription:
    """The robot, but that its first joint has another name."""
    before = description.joint_names[0]
    first = description.joints[0].model_copy(update={"name": "another"})
    urdf = description.urdf.replace(f'"{before}"', '"another"')
    joints = (first, *description.joints[1:])
    return description.model_copy(update={"urdf": urdf, "joints": joints})


def test_what_is_no_message_of_this_robot_is_not_shown(robot, client):
    topic = f"{HERE}/state"
    client.wait_for(lambda: client.messages.get(topic), lambda: robot.say(robot.state()))
    wrong = State(ROBOT.n + 1)
    wrong.session_id = robot.session_id
    for _ in range(3):
        robot.say(wrong)
        robot.say(Event())  # which is read behind it, and shown
        heard = len(client.messages.get(f"{HERE}/events", ()))
        client.wait_for(lambda heard=heard: len(client.messages.get(f"{HERE}/events", ())) > heard)
    last = robot.state(q=1.0)
    client.wait_for(lambda: client.messages[topic][-1] == last.dump(), lambda: robot.say(last))
    assert wrong.dump() not in client.messages[topic]


def test_a_client_that_publishes_is_refused(server):
    with FoxgloveClient(server.port) as client:
        client.wait_for(lambda: client.info)
        assert client.info["capabilities"] == []
        client.advertise("/clicked_point", "geometry_msgs/PointStamped")
        client.publish({"point": {"x": 0.0, "y": 0.0, "z": 0.0}})
        client.wait_for(lambda: len(client.status) >= 2)
    assert "clientPublish" in client.status[0]


@pytest.mark.slow
def test_a_client_that_reads_nothing_holds_up_nobody(server, robot, client):
    """It misses most, and finds the newest when it reads again; another one sees all in time."""
    with FoxgloveClient(server.port) as stuck:
        stuck.look_at_all()
        for each in (stuck, client):
            each.wait_for(lambda each=each: each.messages.get("/robot_description"))
        topic, sent = f"{HERE}/state", 20_000  # more than sockets and the queue can hold
        for _ in range(sent):
            state = robot.state()
            server.state(state.dump(), state)
        for each in (client, stuck):
            last = robot.state().dump()
            each.wait_for(
                lambda each=each, last=last: last in each.messages.get(topic, ())[-9:],
                lambda last=last: server.state(last, state),
            )
    ticks = [State.scalars(payload, "tick")[0] for payload in stuck.messages[topic]]
    assert ticks == sorted(ticks)
    assert len(set(ticks)) < sent / 2


def test_a_port_that_is_taken_is_told_with_what_to_do(server):
    with pytest.raises(PortInUseError, match=f"127.0.0.1:{server.port}.*--port"):
        FoxgloveServer("127.0.0.1", server.port)


def test_an_address_of_another_machine_is_refused():
    with pytest.raises(ConfigError, match="--host"):
        FoxgloveServer("192.0.2.1", 0)


def test_it_listens_on_loopback_alone(server):
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    here = f"{struct.unpack('<I', bytes([127, 0, 0, 1]))[0]:08X}:{server.port:04X}"
    listening = [row[1] for row in rows if row[3] == "0A" and row[1].endswith(here[8:])]
    assert listening == [here]
