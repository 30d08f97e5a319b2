"""The bridges of a robot with certificates: they may what the certificate behind them may."""

from __future__ import annotations

import signal

import pytest
from foxglove_client import FoxgloveClient
from looked_at import assert_ends, assert_shows_joints
from support.certificates.secured_arm import assert_stays, goes
from support.command_bench import Command
from support.pages.steered_arm import FAR, ROBOT, hand

import hoap3

pytestmark = pytest.mark.slow

STATES = f"/robots/{ROBOT}/state"
CLICKED = {
    "header": {"frame_id": "world", "stamp": {"sec": 0, "nsec": 0}},
    "point": dict(zip("xyz", FAR, strict=True)),
}


@pytest.mark.parametrize("name", ["otto", "anna"])
def test_foxglove_steers_with_an_operators_certificate_alone(name, secured, certs):
    words = ("--connect", secured, "--secure", certs / name, "--port", 0, "--steer")
    with (
        Command("bridge", "foxglove", ROBOT, *words) as command,
        hoap3.connect(ROBOT, secured, secure=certs / "otto") as robot,
        FoxgloveClient(int(command.wait_for(r"ws://127\.0\.0\.1:(\d+)")[1])) as client,
    ):
        place = hand(robot.state())
        client.look_at_all()
        client.wait_for(lambda: client.messages.get(STATES))
        client.advertise("/clicked_point", "geometry_msgs/PointStamped")
        client.publish(CLICKED)
        if name == "anna":
            goes(robot, FAR)
        else:
            client.wait_for(lambda: client.status)
            assert_stays(robot, place)
        assert_ends(command, signal.SIGINT)


def test_ros2_sees_the_joints_by_an_observers_certificate(secured, certs):
    assert_shows_joints(ROBOT, "--connect", secured, "--secure", certs / "otto")
