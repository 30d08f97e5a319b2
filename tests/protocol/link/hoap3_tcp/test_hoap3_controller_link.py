"""Our controller's end of HOAP-3's protocol, with robots that are not ours."""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest
from hoap3_sockets import KINDS, PATIENCE_S, cut, taken

from hoap3.protocol.config.settings import Hoap3TcpSettings
from hoap3.protocol.link.hoap3_tcp import controller_link
from hoap3.protocol.link.hoap3_tcp.controller_link import Hoap3ControllerLink
from hoap3.protocol.link.hoap3_tcp.frames import Frames
from hoap3.robot_emulator.robots import load

HOAP3 = load("hoap3")
START = HOAP3.initial_position
CUTS = ("close", "reset", "half")


class OtherRobot:
    """Both listeners of a robot, played by hand."""

    def __init__(self, order: str, slots: int) -> None:
        self.listeners = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
        for listener in self.listeners:
            listener.settimeout(PATIENCE_S)
        init, control = (listener.getsockname()[1] for listener in self.listeners)
        self.settings = Hoap3TcpSettings(
            init_port=init, control_port=control, order=order, slots=slots
        )
        self.frames = Frames(HOAP3, slots)

    def close(self) -> None:
        for listener in self.listeners:
            listener.close()

    def follow(self, link: Hoap3ControllerLink) -> socket.socket:
        """Take the controller for a client."""
        assert link.ask("description") is not None
        assert link.ask("status") is not None
        assert link.ask("acquire") is not None
        with self.listeners[0].accept()[0] as first:
            cycle, check = struct.unpack("<2d", first.recv(16, socket.MSG_WAITALL))
        assert (cycle, check) == (1.0, self.settings.check_s)
        client = self.listeners[1].accept()[0]
        client.settimeout(PATIENCE_S)
        if self.settings.order == "legacy":
            assert self.read(client) == self.frames.pack(START)
        return client

    def read(self, client: socket.socket) -> bytes:
        return client.recv(self.frames.size, socket.MSG_WAITALL)


@pytest.fixture(params=KINDS)
def robot(request: pytest.FixtureRequest) -> Iterator[OtherRobot]:
    with closing(OtherRobot(*request.param)) as made:
        yield made


@pytest.mark.parametrize("end", CUTS)
def test_it_survives_a_robot_that_is_cut_off_at_any_byte_of_a_frame(
    end: str, robot: OtherRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(controller_link, "SENT_AWAY_S", 0.0)  # this robot sends nobody away
    with closing(Hoap3ControllerLink(HOAP3, robot.settings, "law")) as link:
        for sent in range(robot.frames.size):
            with robot.follow(link) as client:
                client.sendall(robot.frames.pack(START)[:sent])
                cut(client, end)
                assert link.wait() is None
            assert link.departures == sent + 1
            assert not link.presence.is_set()
        with robot.follow(link) as client:
            client.sendall(robot.frames.pack(START))
            assert np.allclose(taken(link).q, START, atol=1e-4)
        assert link.departures == robot.frames.size


def test_it_connects_again_where_the_robot_did_not_wait_for_it(robot: OtherRobot) -> None:
    """A robot waits for some seconds; a controller may take longer to be built."""
    with closing(Hoap3ControllerLink(HOAP3, robot.settings, "law")) as link:
        assert link.ask("description") is not None
        robot.listeners[0].accept()[0].close()
        robot.follow(link).close()


def test_it_leaves_nothing_open(robot: OtherRobot) -> None:
    def files() -> int:
        return len(os.listdir("/proc/self/fd"))

    before = files()
    for closes in (True, False):
        with closing(Hoap3ControllerLink(HOAP3, robot.settings, "law")) as link:
            link.ask("description")
            with robot.listeners[0].accept()[0]:
                if not closes:
                    continue
            robot.follow(link).close()
            assert link.wait() is None
    assert files() == before


def test_a_connection_that_fails_at_once_is_no_departure(
    robot: OtherRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would end the next engagement, too."""
    monkeypatch.setattr(controller_link, "CONNECT_S", 0.1)
    with closing(Hoap3ControllerLink(HOAP3, robot.settings, "law")) as link:
        robot.listeners[1].close()
        link.ask("description")
        assert link.ask("acquire") is None
        assert link.departures == 0
