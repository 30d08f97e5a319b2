"""Keys of the wire: what a robot publishes, and how requests name the client."""

from __future__ import annotations

import pytest
from loopback import PATIENCE_S, eventually, free_endpoint

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_session import ask, key, open_session
from hoap3.protocol.messages import State


def test_a_robot_publishes_on_these_keys_only(network):
    robot, controller = network.pair(blocking=True)
    seen = controller._session.declare_subscriber(key("arm", "**"))
    for each in (robot._state, robot._sampled, robot._events):
        eventually(lambda each=each: each.matching_status.matching, "the subscription")
    robot.publish(State(3).dump())
    robot.announce(b"end")
    keys = [str(eventually(seen.try_recv, "a message").key_expr) for _ in range(3)]
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


def test_the_client_of_a_request_is_named_by_its_key_only(network):
    endpoint = free_endpoint()
    robot = network.robot(listen=(endpoint,))
    client = network.keep(open_session(LinkSettings(connect=(endpoint,), mode="client")))
    client.get(key("arm", "ask/status"), payload=b"name", timeout=PATIENCE_S)
    (unnamed,) = eventually(lambda: list(robot.requests()), "a request")
    client.get(key("arm", "ask/status/name"), payload=b"body", timeout=PATIENCE_S)
    (named,) = eventually(lambda: list(robot.requests()), "another request")
    assert (unnamed.verb, unnamed.who) == ("status", "")
    assert (named.verb, named.who, named.body) == ("status", "name", b"body")


def test_a_request_without_an_answer_gives_none(network):
    session = network.keep(open_session(LinkSettings(listen=(free_endpoint(),))))
    assert ask(session, "arm", "status", "me") is None
