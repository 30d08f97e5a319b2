"""The bridges of a robot with certificates: they may what the certificate behind them may."""

from __future__ import annotations

import signal

import pytest
import zenoh
from foxglove_client import FoxgloveClient
from looked_at import until
from support.certificates.secured_arm import assert_stays, goes
from support.command_bench import Command, endpoint
from support.pages.steered_arm import FAR, ROBOT, hand

import hoap3
from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_session import open_session

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
        FoxgloveClient(int(command.hear(r"ws://127\.0\.0\.1:(\d+)")[1])) as client,
    ):
        place = hand(robot.state())
        client.look_at_all()
        client.hear(lambda: client.messages.get(STATES))
        client.advertise("/clicked_point", "geometry_msgs/PointStamped")
        client.publish(CLICKED)
        if name == "anna":
            goes(robot, FAR)
        else:
            client.hear(lambda: client.status)
            assert_stays(robot, place)
        assert command.end(signal.SIGINT) == 0
        assert "Traceback" not in command.stderr


def test_ros2_sees_the_joints_by_an_observers_certificate(secured, certs):
    listens, seen = endpoint(), list[zenoh.Sample]()
    words = ("--connect", secured, "--secure", certs / "otto", "--listen", listens)
    with Command("bridge", "ros2", ROBOT, *words) as command:
        command.hear("is there")
        with open_session(LinkSettings(connect=(listens,))) as peer:
            peer.declare_subscriber("0/joint_states/**", seen.append)
            until(lambda: len(seen) > 20)
        assert command.end(signal.SIGTERM) == 0
        assert "Traceback" not in command.stderr
