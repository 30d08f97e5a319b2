"""What strangers send or open too much of does not part a robot from those whom it serves."""

from __future__ import annotations

import resource
import socket
import threading
from types import SimpleNamespace

import pytest
import zenoh
from loopback import PATIENCE_S, Network, eventually, next_state

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link import zenoh_link
from hoap3.protocol.link.session_limits import (
    MAX_MESSAGE_BYTES,
    MAX_PENDING,
    MAX_REQUEST_BYTES,
    MAX_SESSIONS,
    connection_limits,
    raise_file_limit,
)
from hoap3.protocol.link.zenoh_clients import WAITING_QUERIES
from hoap3.protocol.link.zenoh_link import REFUSED_AT_ONCE, WAITING_ANSWERS
from hoap3.protocol.link.zenoh_session import alive_robots, key, open_session

BLOCK = zenoh.CongestionControl.BLOCK


def stranger(network: Network) -> zenoh.Session:
    """A client that keeps no limits."""
    settings = LinkSettings(connect=(network.endpoint,), mode="client")
    return network.keep(open_session(settings))


@pytest.mark.parametrize("size", [MAX_REQUEST_BYTES + 1, MAX_MESSAGE_BYTES * 2])
def test_a_sample_that_is_too_large_is_dropped_and_nobody_is_cut_off(network, size):
    robot, controller = network.pair(blocking=True)
    session = stranger(network)
    session.put(key("arm", "setpoint"), bytes(size), congestion_control=BLOCK)
    session.put(key("arm", "setpoint"), b"small", congestion_control=BLOCK)
    controller.publish(b"the holder's")
    found: list[bytes] = []
    eventually(lambda: found.extend(p for _, p in robot.drain()) or len(found) == 2, "both")
    assert sorted(found) == [b"small", b"the holder's"]
    assert controller.departures == 0


@pytest.mark.parametrize("size", [MAX_REQUEST_BYTES + 1, MAX_MESSAGE_BYTES * 2])
@pytest.mark.parametrize("leaf", ["ask/status", "control/change"])
def test_a_query_that_is_too_large_gets_no_answer_and_reaches_nobody(network, leaf, size):
    robot, controller = network.pair()
    session = stranger(network)
    replies = session.get(key("arm", leaf), payload=bytes(size), timeout=0.2)
    assert [reply for reply in replies if reply.ok] == []
    assert list(robot.requests()) == []
    assert controller.request() is None
    robot.publish(b"state")
    assert next_state(controller)[1] == b"state"
    assert controller.departures == 0


def test_a_description_of_the_largest_size_arrives(network):
    robot, controller = network.pair()
    asked = network.start(controller.ask, "description", PATIENCE_S)
    request = eventually(lambda: next(iter(robot.requests()), None), "the request")
    request.answer(bytes(1 << 20))
    assert len(asked.result(PATIENCE_S)) == 1 << 20


def test_stop_is_served_before_all_that_came_earlier(network):
    robot, _ = network.pair(blocking=True)
    session = stranger(network)
    for number in range(2 * WAITING_QUERIES):
        session.get(key("arm", f"ask/status/{number}"))
    session.get(key("arm", "ask/stop/in_need"))
    session.put(key("arm", "setpoint"), b"behind them all", congestion_control=BLOCK)
    assert robot.arrival.wait(PATIENCE_S)
    first, *rest = robot.requests()
    assert (first.verb, first.who) == ("stop", "in_need")
    assert 0 < len(rest) <= WAITING_QUERIES
    assert {request.verb for request in rest} == {"status"}


def test_a_stop_is_answered_once(network):
    robot, controller = network.pair()
    answer = network.start(controller.ask, "stop", PATIENCE_S)
    (request,) = eventually(lambda: list(robot.requests()), "the request")
    request.answer({"mode": "stopped"})
    assert answer.result(PATIENCE_S) == b'{"mode": "stopped"}'
    assert list(robot.requests()) == []


def test_queries_that_nobody_serves_hold_up_no_setpoint(network):
    robot, controller = network.pair(blocking=True)
    session = stranger(network)
    for _ in range(20 * WAITING_QUERIES):
        session.get(key("arm", "ask/status/x"))
    session.put(key("arm", "setpoint"), b"behind the queries", congestion_control=BLOCK)
    controller.publish(b"setpoint")
    found: list[bytes] = []
    eventually(lambda: found.extend(each for _, each in robot.drain()) or len(found) == 2, "both")
    assert {*found} == {b"behind the queries", b"setpoint"}
    assert len(list(robot.requests())) <= WAITING_QUERIES


def arrived(session, robot):
    """What the session asked before this has reached the robot."""
    robot.arrival.clear()
    session.put(key("arm", "setpoint"), b"behind them all", congestion_control=BLOCK)
    assert robot.arrival.wait(PATIENCE_S)
    robot.drain()


def test_answers_that_cannot_leave_are_bounded(network, monkeypatch):
    robot, _ = network.pair(blocking=True)
    session = stranger(network)
    monkeypatch.setattr(
        "hoap3.protocol.link.zenoh_link._reply", lambda *_: robot._receiver.join(PATIENCE_S)
    )
    session.get(key("arm", "ask/status/x"))
    request = eventually(lambda: next(iter(robot.requests()), None), "the request")
    for _ in range(WAITING_ANSWERS + 1):
        request.answer(b"bytes")
    for _ in range(10):
        session.get(key("arm", "ask/status/x"))
    arrived(session, robot)
    assert list(robot.requests()) == []
    session.get(key("arm", "ask/stop/x"))
    (stop,) = eventually(lambda: list(robot.requests()), "a stop, which is taken all the same")
    for _ in range(WAITING_ANSWERS + 2):
        stop.answer(b"bytes")
    session.get(key("arm", "ask/stop/x"))
    arrived(session, robot)
    assert list(robot.requests()) == []


def test_a_stop_is_answered_while_nobody_takes_the_other_answers(network, monkeypatch):
    robot, controller = network.pair()
    session, free, reply = stranger(network), threading.Event(), zenoh_link._reply

    def stuck(query, payload):
        if "stop" not in str(query.key_expr):
            free.wait(PATIENCE_S)
        reply(query, payload)

    monkeypatch.setattr(zenoh_link, "_reply", stuck)
    session.get(key("arm", "ask/status/x"))
    request = eventually(lambda: next(iter(robot.requests()), None), "the request")
    for _ in range(WAITING_ANSWERS + 1):
        request.answer(b"bytes")
    answer = network.start(controller.ask, "stop", PATIENCE_S)
    (stop,) = eventually(lambda: list(robot.requests()), "the stop")
    stop.answer({"mode": "stopped"})
    assert answer.result(PATIENCE_S) == b'{"mode": "stopped"}'
    free.set()


def test_stops_that_are_refused_are_passed_over_at_once_and_all_else_is_not(network):
    robot, _ = network.pair(blocking=True)
    session, seen = stranger(network), list[str]()
    robot._guard = SimpleNamespace(
        follows=lambda _: True, admitted=lambda request: seen.append(request.verb), close=list
    )
    for number in range(2 * REFUSED_AT_ONCE):
        session.get(key("arm", f"ask/status/{number}"))
        session.get(key("arm", f"ask/stop/{number}"))
    session.put(key("arm", "setpoint"), b"behind them all", congestion_control=BLOCK)
    assert robot.arrival.wait(PATIENCE_S)
    for verbs in (["stop"] * 2 * REFUSED_AT_ONCE, *2 * [["status"] * REFUSED_AT_ONCE]):
        assert list(robot.requests()) == []
        assert seen == verbs
        seen.clear()


def test_three_hundred_connections_that_say_nothing_keep_no_client_out(network):
    robot, controller = network.pair()
    host, _, port = network.endpoint.removeprefix("tcp/").rpartition(":")
    silent = [socket.create_connection((host, int(port))) for _ in range(300)]
    try:
        assert alive_robots(stranger(network)) == ["arm"]
        robot.publish(b"state")
        assert next_state(controller)[1] == b"state"
    finally:
        for one in silent:
            one.close()


@pytest.mark.parametrize(
    ("files", "pending", "sessions"),
    [
        (1 << 20, MAX_PENDING, MAX_SESSIONS),
        (4096, MAX_PENDING, MAX_SESSIONS),
        (1024, 448, 448),
        (64, 8, 8),
    ],
)
def test_connections_fit_in_the_files_that_may_be_open(files, pending, sessions):
    assert connection_limits(files) == (pending, sessions)


def test_the_limit_of_open_files_is_raised_once_and_never_lowered():
    raised = raise_file_limit()
    assert raised == raise_file_limit()
    assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] >= min(raised, 4096)
