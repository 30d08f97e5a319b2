"""One name, one robot: sessions of robots on real networks, and how two of one name are seen."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from loopback import Network, eventually, free_endpoint, next_state

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.errors import NameTakenError
from hoap3.protocol.link.robot_sessions import RobotSession, name_conflict
from hoap3.protocol.link.zenoh_link import ZenohControllerLink, ZenohRobotLink
from hoap3.protocol.link.zenoh_session import check_unique, key, open_session, robot_sessions, zenoh
from hoap3.protocol.messages import State

INCUMBENT, NEWER, SAME = 1, 2, 3  # sessions


def router(network: Network, at: str) -> Any:
    """A Zenoh router that listens."""
    config = {
        "mode": "router",
        "listen": {"endpoints": [at]},
        "scouting": {"multicast": {"enabled": False}},
    }
    return network.keep(zenoh.open(zenoh.Config.from_json5(json.dumps(config))))


def robot(network: Network, session_id: int, reports: list[str], **link: Any) -> ZenohRobotLink:
    return network.keep(
        ZenohRobotLink("arm", LinkSettings(**link), report=reports.append, session_id=session_id)
    )


def state(session_id: int, tick: int, *, held: bool = False) -> bytes:
    message = State(2)
    message.session_id, message.tick = session_id, tick
    message.mode, message.epoch_from_tick = (State.ACTIVE, 1) if held else (State.IDLE, 0)
    return message.dump()


@contextmanager
def repeated(robot: ZenohRobotLink, message: bytes) -> Iterator[None]:
    """Publish a State again and again, as a robot does: a change of presence may replace one."""
    ended = threading.Event()

    def publish() -> None:
        while not ended.wait(0.01):
            robot.publish(message)

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def test_a_token_names_its_session_and_other_tokens_are_ignored():
    session = RobotSession(5, 2**63, 12, "a,b/ü", "tcp/[::1]:7447")
    assert RobotSession.read(key("arm", f"session/{session.leaf}")) == session
    for leaf in ("", "1", "1,2,3,4", "1,x,3,host,", "1,2,3,a,b,c", "1" * 2000 + ",2,3,a,b"):
        assert RobotSession.read(f"robots/arm/session/{leaf}") is None


def test_a_conflict_names_both_endpoints_the_incumbent_first():
    first = RobotSession(1, 7, 12, "host", "tcp/127.0.0.1:1")
    second = RobotSession(2, 6, 13, "host", "tcp/127.0.0.1:2")
    text = name_conflict("arm", [second, first])
    assert "'arm'" in text
    assert 0 < text.index("tcp/127.0.0.1:1 (process 12") < text.index("tcp/127.0.0.1:2 (process 13")


@pytest.mark.slow
def test_two_peers_at_one_router_do_not_start_under_one_name(network):
    at, reports = free_endpoint(), list[str]()
    router(network, at)
    first, second = free_endpoint(), free_endpoint()
    incumbent = robot(network, INCUMBENT, reports, listen=(first,), connect=(at,))
    with pytest.raises(NameTakenError, match=rf"'arm'.*{first}"):
        robot(network, NEWER, [], listen=(second,), connect=(at,))
    eventually(lambda: any(second in text for text in reports), "a report of the other")
    eventually(lambda: incumbent.name_conflicts == 0, "the end of the conflict")


@pytest.fixture
def conflict(network) -> tuple[Network, ZenohRobotLink, ZenohRobotLink, str, list[str]]:
    """Two robots of one name, whose common router starts after them."""
    at, reports = free_endpoint(), list[str]()
    pair = [
        robot(network, number, reports, listen=(free_endpoint(),), connect=(at,))
        for number in (INCUMBENT, NEWER)
    ]
    assert [one.name_conflicts for one in pair] == [0, 0]
    router(network, at)
    eventually(lambda: [one.name_conflicts for one in pair] == [1, 1], "the conflict")
    return network, *pair, at, reports


@pytest.mark.slow
def test_two_that_become_visible_to_each_other_both_report_it(conflict):
    _, first, second, _, reports = conflict
    places = [one._name._own.endpoint for one in (first, second)]
    eventually(lambda: len(reports) >= 2, "both reports")
    for text in reports[:2]:
        assert "'arm'" in text
        assert all(place in text for place in places)
    second.close()
    eventually(lambda: first.name_conflicts == 0, "the end of the conflict")


@pytest.mark.slow
def test_a_client_that_sees_two_sessions_refuses_and_names_both(conflict):
    network, first, second, at, _ = conflict
    session = network.keep(open_session(LinkSettings(mode="client", connect=(at,))))
    eventually(lambda: len(robot_sessions(session, "arm")) == 2, "both tokens")
    with pytest.raises(NameTakenError) as refused:
        check_unique(session, "arm")
    for one in (first, second):
        assert one._name._own.endpoint in str(refused.value)
    check_unique(session, "leg")
    second.close()
    eventually(lambda: len(robot_sessions(session, "arm")) == 1, "one token")
    check_unique(session, "arm")


@pytest.mark.slow
def test_a_newer_robot_without_a_holder_sends_no_states(conflict):
    network, first, second, at, _ = conflict
    link = network.keep(ZenohControllerLink("arm", LinkSettings(mode="client", connect=(at,)), "t"))
    eventually(link.name_conflict, "both robots")
    for one in (first, second):
        eventually(lambda: one._state.matching_status.matching, "a subscriber")  # noqa: B023
    for tick in range(20):
        second.publish(state(NEWER, tick))
    with repeated(first, state(INCUMBENT, 100)):
        assert next_state(link)[1] == state(INCUMBENT, 100)
    with repeated(second, state(NEWER, 101, held=True)):
        while (found := next_state(link)[1]) != state(NEWER, 101, held=True):
            assert found == state(INCUMBENT, 100)


@pytest.mark.slow
def test_the_incumbents_controller_does_not_lose_it_where_the_other_robot_ends(conflict):
    network, first, second, at, _ = conflict
    link = network.keep(ZenohControllerLink("arm", LinkSettings(mode="client", connect=(at,)), "t"))
    link.session_id = INCUMBENT
    eventually(lambda: link.presence.is_set() and link.name_conflict(), "both robots")
    second.close()
    eventually(lambda: not link.name_conflict(), "one robot")
    assert (link.departures, link.presence.is_set()) == (0, True)
    first.close()
    eventually(lambda: link.departures > 0, "its end")
    assert not link.presence.is_set()


@pytest.mark.slow
def test_robots_in_lockstep_with_one_seed_are_told_apart(network):
    at, reports = free_endpoint(), list[str]()
    pair = [
        robot(network, SAME, reports, listen=(free_endpoint(),), connect=(at,)) for _ in range(2)
    ]
    router(network, at)
    eventually(lambda: [one.name_conflicts for one in pair] == [1, 1], "the conflict")
