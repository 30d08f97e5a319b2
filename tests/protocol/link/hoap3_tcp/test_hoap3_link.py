"""HOAP-3's protocol on real sockets: clients that behave, and clients that do not."""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest
from hoap3_sockets import KINDS, PATIENCE_S, cut, taken

from hoap3.protocol.config.settings import Hoap3TcpSettings
from hoap3.protocol.errors import PortInUseError
from hoap3.protocol.link.base import Request
from hoap3.protocol.link.hoap3_tcp import client_connection
from hoap3.protocol.link.hoap3_tcp.controller_link import Hoap3ControllerLink
from hoap3.protocol.link.hoap3_tcp.frames import Frames
from hoap3.protocol.link.hoap3_tcp.robot_link import FIFO, Hoap3RobotLink
from hoap3.protocol.messages import Setpoint, State
from hoap3.robot_emulator.robots import load

HOAP3 = load("hoap3")


class Robot:
    """A robot's link, and a loop that a test plays by hand."""

    def __init__(self, order: str = "paper", slots: int = 21) -> None:
        self.said: list[str] = []
        self.settings = Hoap3TcpSettings(init_port=0, control_port=0, order=order, slots=slots)
        self.link = Hoap3RobotLink(HOAP3, self.settings, self.said.append)
        self.frames = Frames(HOAP3, slots)
        self.state = State(HOAP3.n)
        self.state.session_id, self.state.epoch, self.state.mode = 7, 3, State.ACTIVE
        self.requests: list[Request] = []

        self.close = self.link.close

    def controller(self) -> Hoap3ControllerLink:
        """Our controller's end."""
        ports = dict(zip(("init_port", "control_port"), self.link.ports, strict=True))
        return Hoap3ControllerLink(HOAP3, self.settings.model_copy(update=ports), "law")

    def engaged(self) -> Hoap3ControllerLink:
        """Our controller's end, connected and granted."""
        link = self.controller()
        assert link.ask("description") == HOAP3.to_json()
        assert link.ask("status") is not None
        assert link.ask("acquire") is not None
        self.wait_for("acquire").answer({"granted": True})
        return link

    def client(self, cycle: float = 1, check: float = 10, room: int = 0) -> socket.socket:
        """A client that is followed; `room` [bytes] is for what it has not read."""
        made = self.begin(struct.pack("<2d", cycle, check), room)
        made.settimeout(PATIENCE_S)
        self.wait_for("acquire").answer({"granted": True})
        return made

    def begin(self, data: bytes, room: int = 0) -> socket.socket:
        """Send the beginning, and connect to the second port."""
        made = socket.socket()
        if room:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, room)
        with socket.create_connection(("127.0.0.1", self.link.ports[0])) as first:
            first.sendall(data)
            made.connect(("127.0.0.1", self.link.ports[1]))
        return made

    def wait_for(self, verb: str) -> Request:
        """The next request, which is of this kind."""

        def heard() -> bool:
            self.requests += self.link.requests()
            return bool(self.requests)

        self.until(heard)
        request = self.requests.pop(0)
        assert request.verb == verb
        return request

    def publish(self, tick: int, q: np.ndarray | None = None) -> None:
        self.state.tick, self.state.stamp_published = tick, 1000 * tick
        self.state.q[:] = 0.0 if q is None else q
        self.link.publish(self.state.dump())

    def serve(self, client: socket.socket, tick: int) -> None:
        """One exchange of a client that is followed."""
        self.publish(tick)
        client.sendall(self.frames.pack(HOAP3.initial_position))
        assert self.answers(1)[-1].tick == tick

    def answers(self, count: int) -> list[Setpoint]:
        """So many answers, which arrive in time."""
        found: list[Setpoint] = []

        def came() -> bool:
            for _, payload in self.link.drain():
                answer = Setpoint(HOAP3.n)
                answer.load(payload)
                found.append(answer)
            return len(found) >= count

        self.until(came)
        return found

    def until(self, holds) -> None:
        """Wait for what the link's thread does."""
        end = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < end
            self.link.arrival.wait(0.01)
            self.link.arrival.clear()


@pytest.fixture(params=KINDS)
def robot(request: pytest.FixtureRequest) -> Iterator[Robot]:
    with closing(Robot(*request.param)) as made:
        yield made


@pytest.fixture
def paper() -> Iterator[Robot]:
    with closing(Robot()) as made:
        yield made


def read(client: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        more = client.recv(size - len(data))
        assert more
        data += more
    return data


def test_each_frame_answers_the_state_that_was_sent_before_it(robot: Robot) -> None:
    posture = HOAP3.initial_position
    with robot.client() as client:
        if robot.settings.order == "legacy":
            client.sendall(robot.frames.pack(posture))
            robot.until(lambda: robot.link._client.received == 1)
        for tick in range(5, 15):
            robot.publish(tick, posture + tick * 1e-3)
            seen = read(client, robot.frames.size)
            assert seen == robot.frames.pack(posture + tick * 1e-3)
            client.sendall(robot.frames.pack(posture - tick * 1e-3))
            (answer,) = robot.answers(1)
            assert (answer.session_id, answer.tick, answer.epoch) == (7, tick, 3)
            assert answer.stamp_state == 1000 * tick
            asked = robot.frames.unpack(robot.frames.pack(posture - tick * 1e-3))
            assert np.array_equal(answer.values, asked)
    assert robot.link.counts()["overruns"] == robot.link.counts()["unasked"] == 0
    robot.wait_for("gone")


def test_a_client_that_speaks_first_is_sent_nothing_before() -> None:
    robot = Robot("legacy")
    with closing(robot), robot.client() as client:
        robot.publish(1)
        client.sendall(robot.frames.pack(HOAP3.initial_position))
        robot.until(lambda: robot.link._client.received == 1)
        robot.publish(2, HOAP3.initial_position)
        assert read(client, robot.frames.size) == robot.frames.pack(HOAP3.initial_position)
        client.sendall(robot.frames.pack(HOAP3.initial_position))
        assert robot.answers(1)[0].tick == 2


def test_states_for_which_the_fifo_has_no_room_are_counted_and_no_others(paper: Robot) -> None:
    with paper.client() as client:
        for tick in range(FIFO + 3):
            paper.publish(tick)
        for _ in range(FIFO):
            read(client, paper.frames.size)
        client.sendall(FIFO * paper.frames.pack(HOAP3.initial_position))
        assert [answer.tick for answer in paper.answers(FIFO)] == list(range(FIFO))
        paper.serve(client, 20)
    assert paper.link.counts()["overruns"] == 3


def test_a_client_that_never_reads_holds_nothing_up(paper: Robot) -> None:
    with paper.client():
        for tick in range(5000):
            paper.publish(tick)
        assert paper.link.counts()["overruns"] == 5000 - FIFO
    paper.wait_for("gone")


def test_a_client_that_answers_without_reading_is_left(robot: Robot) -> None:
    """It fills what the system keeps for it; nothing waits, and nothing else grows."""
    frame, legacy = robot.frames.pack(HOAP3.initial_position), robot.settings.order == "legacy"
    with robot.client(1, 1000, room=4096) as client:
        served, tick = robot.link._client, 0
        served.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        with contextlib.suppress(ConnectionError):
            while robot.link._client and tick < 100_000:
                tick += 1
                if not legacy:
                    robot.publish(tick)
                client.sendall(frame)
                robot.until(lambda sent=tick: served.received >= sent or not robot.link._client)
                if legacy:
                    robot.publish(tick)
        robot.wait_for("gone")
    assert len(robot.said) == 1


def test_the_same_state_is_sent_once(paper: Robot) -> None:
    with paper.client() as client:
        paper.publish(1)
        paper.publish(1)
        paper.publish(2)
        client.sendall(2 * paper.frames.pack(HOAP3.initial_position))
        assert [answer.tick for answer in paper.answers(2)] == [1, 2]


def test_frames_of_no_use_are_counted(paper: Robot) -> None:
    with paper.client() as client:
        client.sendall(paper.frames.pack(HOAP3.initial_position))
        paper.until(lambda: paper.link.counts()["unasked"] == 1)
        paper.publish(1)
        client.sendall(struct.pack("<21d", *[float("nan")] * 21))
        paper.until(lambda: paper.link.counts()["not_finite"] == 1)
        paper.serve(client, 2)


def test_a_second_client_is_sent_away_at_once(paper: Robot) -> None:
    with paper.client() as client:
        for port in paper.link.ports:
            with socket.create_connection(("127.0.0.1", port)) as second:
                second.settimeout(PATIENCE_S)
                assert second.recv(1) == b""
        paper.serve(client, 1)
    assert paper.link.counts()["refused"] == 2


def test_who_has_exchanged_all_has_given_authority_back(robot: Robot) -> None:
    with robot.client(100, 1) as client:  # ten exchanges
        legacy = robot.settings.order == "legacy"
        for tick in range(10):
            if legacy:
                client.sendall(robot.frames.pack(HOAP3.initial_position))
                robot.until(lambda wanted=tick + 1: robot.link._client.received == wanted)
            robot.publish(tick)
            read(client, robot.frames.size)
            if not legacy:
                client.sendall(robot.frames.pack(HOAP3.initial_position))
                robot.answers(1)
        robot.wait_for("release")
        assert client.recv(1) == b""


@pytest.mark.parametrize("end", ["close", "reset", "half"])
def test_a_connection_that_is_cut_anywhere_is_survived(end: str, paper: Robot) -> None:
    """Each byte of the beginning, and of an exchange."""
    for sent in range(16):
        with socket.create_connection(("127.0.0.1", paper.link.ports[0])) as first:
            first.sendall(bytes(sent))
            cut(first, end)
    for sent in range(paper.frames.size + 1):
        with paper.client() as client:
            paper.publish(sent)
            client.sendall(paper.frames.pack(HOAP3.initial_position)[:sent])
            cut(client, end)
            assert paper.wait_for("gone").who == f"hoap3_tcp-{sent + 1}"
    paper.link.drain()
    with paper.client() as client:
        paper.serve(client, 1000)
    assert paper.link.counts()["refused"] == 16


@pytest.mark.parametrize("end", ["close", "wait"])
def test_who_goes_after_its_last_exchange_has_given_authority_back(end: str, robot: Robot) -> None:
    for _ in range(10):
        robot.state.tick += 1
        exchanged(robot, end)
        robot.wait_for("release")
    assert robot.said == []


def exchanged(robot: Robot, end: str) -> None:
    """One exchange of one; in each order, the end comes right after the last frame."""
    with robot.client(1000, 1) as client:
        if robot.settings.order == "legacy":
            client.sendall(robot.frames.pack(HOAP3.initial_position))
            robot.until(lambda: robot.link._client.received == 1)
        robot.publish(robot.state.tick)
        read(client, robot.frames.size)
        if robot.settings.order == "paper":
            client.sendall(robot.frames.pack(HOAP3.initial_position))
        if end == "wait":
            assert client.recv(1) == b""


def test_frames_that_are_too_long_are_not_followed(paper: Robot) -> None:
    with paper.client() as client:
        paper.publish(1)
        client.sendall(bytes(176))
        paper.answers(1)
        read(client, paper.frames.size)
        assert ended(client)
        paper.wait_for("gone")
    (said,) = paper.said
    assert "link.hoap3_tcp.slots" in said


def ended(client: socket.socket) -> bool:
    """Whether the robot ends the connection, by which means ever."""
    try:
        return client.recv(1) == b""
    except ConnectionResetError:
        return True


def test_frames_that_are_too_short_are_named(paper: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_connection, "DOUBT_S", 0.05)
    with paper.client() as client:
        paper.publish(1)
        client.sendall(bytes(160))
        paper.until(lambda: any("link.hoap3_tcp.slots" in text for text in paper.said))
    paper.wait_for("gone")


def test_two_ends_that_wait_for_each_other_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_connection, "DOUBT_S", 0.05)
    robot = Robot("legacy")
    with closing(robot), robot.client():
        robot.publish(1)
        robot.until(lambda: any("link.hoap3_tcp.order" in text for text in robot.said))


def test_a_client_that_speaks_first_where_it_should_not_is_named(paper: Robot) -> None:
    with paper.client() as client:
        client.sendall(paper.frames.pack(HOAP3.initial_position))
        paper.until(lambda: any("link.hoap3_tcp.order" in text for text in paper.said))
        paper.serve(client, 1)


def test_a_robot_that_follows_no_more_ends_the_connection(paper: Robot) -> None:
    with paper.client() as client:
        paper.publish(1)
        read(client, paper.frames.size)
        paper.state.mode = State.STOPPING
        paper.publish(2)
        assert client.recv(1) == b""
    paper.wait_for("release")


def test_a_client_that_is_refused_authority_is_left(paper: Robot) -> None:
    with paper.begin(struct.pack("<2d", 1, 10)) as client:
        client.settimeout(PATIENCE_S)
        paper.wait_for("acquire").answer({"granted": False})
        assert client.recv(1) == b""


def test_a_port_in_use_is_named(paper: Robot) -> None:
    taken = Hoap3TcpSettings(init_port=paper.link.ports[0], control_port=0)
    with pytest.raises(PortInUseError, match="hoap3_tcp"):
        Hoap3RobotLink(HOAP3, taken, paper.said.append)


def test_our_controller_sees_positions_and_remembers_what_it_commanded(robot: Robot) -> None:
    start = HOAP3.initial_position
    with closing(robot.engaged()) as link:
        wanted = start.copy()
        for tick in range(20):
            if robot.settings.order == "legacy":
                robot.until(lambda count=tick + 1: robot.link._client.received == count)
            robot.publish(tick, start)
            state = taken(link)
            assert state.tick == tick
            assert state.mode == State.ACTIVE
            shown = robot.frames.unpack(robot.frames.pack(start))
            assert np.array_equal(state.q, shown)
            if tick:
                assert np.array_equal(state.reference, wanted)  # in double, not in counts
                assert not state.dq.any()
            wanted = state.reference + 1e-5  # less than half a count
            answer = Setpoint(HOAP3.n, 4)
            answer.values[:] = wanted
            link.publish(answer.dump())
            (came,) = robot.answers(1)
            assert np.abs(came.values - wanted).max() < 0.6 / np.abs(HOAP3.counts_per_rad).min()
    robot.wait_for("gone")


def test_a_silent_controller_holds_the_reference(paper: Robot) -> None:
    with closing(paper.engaged()) as link:
        paper.publish(1, HOAP3.initial_position)
        first = taken(link)
        paper.publish(2, HOAP3.initial_position)
        taken(link)  # without an answer to the first
        (held,) = paper.answers(1)
        assert held.tick == 1
        assert np.allclose(held.values, first.reference, atol=1e-9)


def test_our_controller_notices_when_the_robot_goes(paper: Robot) -> None:
    with closing(paper.engaged()) as link:
        paper.publish(1)
        taken(link)
        paper.state.mode = State.STOPPED
        paper.publish(2)
        assert link.wait() is None
        assert link.departures == 1
        assert not link.presence.is_set()


def test_our_controller_can_be_woken(paper: Robot) -> None:
    with closing(paper.engaged()) as link:
        link.wake()
        assert link.wait() is None
        assert link.departures == 0


def test_nobody_there_is_no_answer() -> None:
    robot = Robot()
    robot.close()
    with closing(robot.controller()) as link:
        assert link.ask("description") is None
        assert link.ask("acquire") is None


def test_who_knocks_at_the_second_port_alone_is_nobodys_client(paper: Robot) -> None:
    with socket.create_connection(("127.0.0.1", paper.link.ports[1])) as stray:
        stray.settimeout(PATIENCE_S)
        assert stray.recv(1) == b""
    with paper.client() as client:
        paper.serve(client, 1)
    assert paper.link.counts()["clients"] == 1


def test_who_knocks_there_while_another_one_begins_is_not_taken_for_it(paper: Robot) -> None:
    with socket.create_connection(("127.0.0.1", paper.link.ports[0])) as first:
        with socket.create_connection(("127.0.0.1", paper.link.ports[1])) as stray:
            stray.settimeout(PATIENCE_S)
            assert stray.recv(1) == b""
        first.sendall(struct.pack("<2d", 1, 10))
        with socket.create_connection(("127.0.0.1", paper.link.ports[1])) as client:
            client.settimeout(PATIENCE_S)
            paper.wait_for("acquire").answer({"granted": True})
            paper.publish(1, HOAP3.initial_position)
            assert read(client, paper.frames.size) == paper.frames.pack(HOAP3.initial_position)


def test_the_next_client_waits_until_the_loop_has_heard_of_the_last_one(paper: Robot) -> None:
    """So news of clients that come and go cannot pile up."""
    unheard, reception = [], paper.link._reception
    next_client = reception.next_client

    def noted() -> tuple[socket.socket, int] | None:
        unheard.append(len(paper.link._requests))
        return next_client()

    reception.next_client = noted
    for _ in range(20):
        with paper.begin(struct.pack("<2d", 1, 10)):
            paper.wait_for("acquire").answer({"granted": True})
        paper.wait_for("gone")
    assert len(unheard) >= 19
    assert not any(unheard)
    assert len(paper.said) < 20


def test_a_connection_that_a_refused_client_left_is_not_the_next_ones(paper: Robot) -> None:
    for _ in range(20):
        paper.begin(struct.pack("<2d", 0, 0)).close()
    with paper.client() as client:
        paper.serve(client, 1)
    assert paper.wait_for("gone").who == "hoap3_tcp-1"


def test_our_controller_waits_while_the_robot_has_another_client(paper: Robot) -> None:
    with closing(paper.controller()) as link:
        with paper.client():
            assert link.ask("description") is None
        paper.wait_for("gone")
        assert link.ask("description") is not None


def test_our_controller_leaves_a_robot_whose_positions_are_no_numbers(paper: Robot) -> None:
    with closing(paper.engaged()) as link:
        paper.link._client.connection.sendall(struct.pack("<21d", *[float("nan")] * 21))
        assert link.wait() is None
        assert link.departures == 1
    paper.wait_for("gone")


def test_two_ports_are_two() -> None:
    with pytest.raises(ValueError, match="differ"):
        Hoap3TcpSettings(init_port=2600, control_port=2600)
