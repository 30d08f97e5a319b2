"""Peers of version 1 of the wire, spoken by hand, with links of today."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import pytest
import zenoh
from loopback import PATIENCE_S, Network, eventually, free_endpoint

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_clients import WAITING_QUERIES
from hoap3.protocol.link.zenoh_link import ZenohControllerLink, ZenohRobotLink
from hoap3.protocol.link.zenoh_session import ask_versions, key, open_session
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.wire_versions import downgraded


@pytest.fixture
def network() -> Iterator[Network]:
    made = Network()
    yield made
    made.close()


def state(tick: int) -> bytes:
    """A State of today that says more than version 1 can."""
    message = State(3, reference_rate=3, followed=1)
    message.tick = tick
    message.q[:] = 1.0, 2.0, 3.0
    message.reference_rate[:] = 4.0
    return message.dump()


def setpoint(tick: int) -> bytes:
    """A Setpoint of today, likewise."""
    message = Setpoint(3, 2, decision=3, gains=1)
    message.tick = tick
    message.values[:] = 5.0, 6.0, 7.0
    message.decision[:] = 8.0
    return message.dump()


def old_client(network: Network, endpoint: str) -> zenoh.Session:
    """A bare session that knows the keys of version 1 only."""
    return network.keep(open_session(LinkSettings(connect=(endpoint,), mode="client")))


def test_a_client_of_version_1_gets_its_states_and_is_understood(network):
    endpoint, told = free_endpoint(), []
    link = ZenohRobotLink("arm", LinkSettings(listen=(endpoint,)), report=told.append)
    robot = network.keep(link)
    client = old_client(network, endpoint)
    states = client.declare_subscriber(key("arm", "state"))
    eventually(lambda: robot._old_listens, "the subscription")
    client.get(key("arm", "ask/description"), payload=b"old", timeout=PATIENCE_S)
    eventually(lambda: list(robot.requests()), "the request")

    robot.publish(state(7))
    received = states.recv().payload.to_bytes()
    client.put(key("arm", "setpoint"), downgraded(Setpoint, setpoint(7)))
    ((_, arrived),) = eventually(robot.drain, "the answer")

    assert received == downgraded(State, state(7))
    message = Setpoint.like(arrived)
    message.load(arrived)
    assert message.values.tolist() == [5.0, 6.0, 7.0]
    assert len(message.decision) == 0
    assert len(told) == 1


def test_who_only_looks_at_everything_is_no_client_of_version_1(network):
    robot, controller = network.pair(blocking=True)
    seen = controller._session.declare_subscriber(key("arm", "**"))
    eventually(lambda: robot._old_listens, "the subscription")
    robot.publish(state(1))
    robot.announce(b"end")
    keys = [str(seen.recv().key_expr) for _ in range(3)]
    assert sorted(keys) == sorted(
        key("arm", leaf) for leaf in ("state/2", "sampled/state/2", "events")
    )


@pytest.mark.parametrize("name", ["ask", "control", "state"])
def test_a_robot_may_have_the_name_of_a_key(network, name):
    endpoint = free_endpoint()
    robot = network.robot(name, listen=(endpoint,))
    controller = network.controller(endpoint, name)
    answer = network.start(controller.ask, "stop", PATIENCE_S)
    (request,) = eventually(lambda: list(robot.requests()), "the request")
    assert (request.verb, request.who) == ("stop", "test")
    request.answer(b"stopped")
    assert answer.result(PATIENCE_S) == b"stopped"


def test_a_question_that_a_flood_pushed_out_is_no_sign_of_version_1(network):
    _, controller = network.pair()
    client = old_client(network, network.endpoint)
    question = controller._session, "arm", "description", "test", b"", 2.0 * PATIENCE_S
    answer = network.start(ask_versions, *question)

    def answered_in_a_flood() -> bool:  # as the question may come after the first ones
        flood = [client.get(key("arm", f"ask/status/{n}")) for n in range(2 * WAITING_QUERIES)]
        for pushed_out in flood[:WAITING_QUERIES]:  # all that waited would be slow to close
            list(pushed_out)
        return answer.done()

    eventually(answered_in_a_flood, "the end of the question")
    assert answer.result() == (2, None)


def test_who_asks_as_in_version_1_is_known_by_its_payload(network):
    endpoint = free_endpoint()
    robot = network.robot(listen=(endpoint,))
    client = old_client(network, endpoint)
    client.get(key("arm", "ask/status"), payload=b"old", timeout=PATIENCE_S)
    (old,) = eventually(lambda: list(robot.requests()), "a request")
    client.get(key("arm", "ask/status/new"), payload=b"more", timeout=PATIENCE_S)
    (new,) = eventually(lambda: list(robot.requests()), "another request")

    assert (old.verb, old.who, old.version) == ("status", "old", 1)
    assert (new.verb, new.who, new.version, new.body) == ("status", "new", 2, b"more")


def test_while_nobody_of_version_1_listens_nothing_is_sent_for_it(network):
    robot, controller = network.pair(blocking=True)
    assert not robot._old_listens
    robot.publish(state(1))
    _, payload = eventually(controller.wait, "a State")
    assert payload == state(1)


class OldRobot:
    """A robot of version 1: its keys, and an answer to every request."""

    def __init__(self, endpoint: str) -> None:
        self.session = session = open_session(LinkSettings(listen=(endpoint,)))
        self.states = session.declare_publisher(key("arm", "state"))
        self.setpoints = session.declare_subscriber(key("arm", "setpoint"))
        session.declare_queryable(key("arm", "ask/*"), self._answer)
        self.token = session.liveliness().declare_token(key("arm", "alive"))

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, b"old " + query.payload.to_bytes())

    def close(self) -> None:
        self.session.close()


def test_a_robot_of_version_1_is_spoken_to_in_version_1(network):
    endpoint = free_endpoint()
    robot = network.keep(OldRobot(endpoint))
    link = network.keep(ZenohControllerLink("arm", LinkSettings(connect=(endpoint,)), "me"))
    assert link.presence.wait(PATIENCE_S)
    assert link.wire_version == 2

    assert eventually(lambda: link.ask("description"), "an answer") == b"old me"
    assert link.wire_version == 1
    eventually(lambda: robot.states.matching_status.matching, "the subscription")
    robot.states.put(downgraded(State, state(3)))
    _, payload = eventually(link.wait, "a State")
    link.publish(setpoint(3))
    answer = robot.setpoints.recv().payload.to_bytes()

    message = State.like(payload)
    message.load(payload)
    assert (message.tick, len(message.reference_rate)) == (3, 0)
    assert answer == downgraded(Setpoint, setpoint(3))
    assert struct.unpack_from("<I", answer, 4) == (1,)
    link.wake()
    assert link.wait() is None


def test_a_robot_that_hears_and_is_silent_is_not_asked_twice(network):
    robot, controller = network.pair()
    assert controller.ask("status", timeout_s=0.05) is None
    eventually(lambda: list(robot.requests()), "the request")
    assert controller.wire_version == 2


def test_nobody_answers_in_no_version(network):
    session = network.keep(open_session(LinkSettings(listen=(free_endpoint(),))))
    assert ask_versions(session, "arm", "status", "me")[1] is None
