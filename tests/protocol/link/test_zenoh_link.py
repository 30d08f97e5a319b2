"""Both sides of the link over real sessions on loopback."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
import zenoh
from loopback import (
    PATIENCE_S,
    came,
    eventually,
    free_endpoint,
    known,
    listening,
    next_state,
    token_seen,
)

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.errors import LinkError, NameTakenError, PortInUseError
from hoap3.protocol.link.base import Request
from hoap3.protocol.link.session_limits import MAX_REQUEST_BYTES
from hoap3.protocol.link.zenoh_link import FRESH_S, OTHERS, ZenohControllerLink, ZenohRobotLink
from hoap3.protocol.link.zenoh_session import (
    EVENTS_AT_ONCE,
    alive_robots,
    fast_publisher,
    key,
    open_session,
    sampled_key,
)
from hoap3.protocol.messages import Setpoint, State

HERE = Path(__file__).parent
VANISHING = HERE.parents[1] / "support" / "attacks" / "vanishing_client.py"
LISTENER = """
import sys, zenoh
from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_session import key, open_session

session = open_session(LinkSettings(connect=(sys.argv[1],)))
everything = session.declare_subscriber(key("arm", "**"), zenoh.handlers.RingChannel(1))
events = session.declare_subscriber(key("arm", "events"), zenoh.handlers.RingChannel(256))
print("ready", flush=True)
while (event := events.recv().payload.to_string()) != "last":
    print(event)
session.close()
"""
FULL_BYTES = 16 << 20  # more than the kernel keeps for who does not read


def test_keys_are_those_of_the_wire_document():
    assert key("arm", "state") == "robots/arm/state"


def test_a_state_arrives_with_the_stamp_of_its_arrival(network):
    robot, controller = network.pair()
    before = time.monotonic_ns()
    robot.publish(b"state 1")
    stamp, payload = next_state(controller)
    assert payload == b"state 1"
    assert before <= stamp <= time.monotonic_ns()


@pytest.mark.parametrize(("policy", "times"), [(os.SCHED_FIFO, 1), (os.SCHED_OTHER, 0)])
def test_both_sides_let_zenoh_send_at_once_where_it_would_wait_for_them(
    policy, times, network, monkeypatch
):
    gave_way = []
    monkeypatch.setattr(os, "sched_getscheduler", lambda _: policy)
    monkeypatch.setattr(os, "sched_yield", lambda: gave_way.append(True))
    for side in network.pair():
        gave_way.clear()
        side.publish(b"message")
        assert len(gave_way) == times


def test_a_setpoint_arrives_with_the_stamp_of_its_arrival_however_late_it_is_drained(network):
    robot, controller = network.pair(blocking=True)
    before = time.monotonic_ns()
    controller.publish(b"setpoint 1")
    assert robot.arrival.wait(PATIENCE_S)
    arrived = time.monotonic_ns()
    ((stamp, payload),) = robot.drain()
    assert payload == b"setpoint 1"
    assert before <= stamp <= arrived
    assert robot.drain() == []


def grant(network, robot, ask):
    """Give authority to who asks for it so."""
    answer = network.start(ask, "acquire")
    (request,) = eventually(lambda: list(robot.requests()), "a request")
    request.answer({"granted": True, "epoch": 1})
    assert answer.result(PATIENCE_S)


def test_setpoints_of_the_holder_are_drained_in_the_order_in_which_they_came(network):
    robot, controller = network.pair(blocking=True)
    grant(network, robot, controller.ask)
    sent = [b"%d" % number for number in range(500)]
    for payload in sent:
        controller.publish(payload)
    found: list[tuple[int, bytes]] = []
    eventually(lambda: found.extend(robot.drain()) or len(found) == len(sent), "all setpoints")
    assert [payload for _, payload in found] == sent
    assert [stamp for stamp, _ in found] == sorted(stamp for stamp, _ in found)


def flooded(network, robot, name, count):
    """Send so many setpoints under a name, until the robot has taken or dropped each."""
    before = robot.counts()["crowded_out"] + robot._others
    session = network.keep(open_session(LinkSettings(connect=(network.endpoint,))))
    strange = fast_publisher(session, key("arm", f"setpoint/{name}"), blocking=True)
    eventually(lambda: strange.matching_status.matching, "a subscriber")
    for _ in range(count):
        strange.put(b"strange")
    eventually(
        lambda: robot.counts()["crowded_out"] + robot._others >= before + count, "the last one"
    )


def test_of_a_flood_of_others_few_are_looked_at_and_all_of_the_holder(network):
    robot, controller = network.pair(blocking=True)
    eventually(lambda: controller._setpoint.matching_status.matching, "a subscriber to setpoints")
    grant(network, robot, controller.ask)
    flooded(network, robot, "stranger", 300)
    sent = [Setpoint(3).dump()] * 5
    for payload in sent:
        controller.publish(payload)
    found: list[bytes] = []
    eventually(lambda: found.extend(p for _, p in robot.drain()) or len(found) == 7, "all of them")
    assert found == [b"strange"] * OTHERS + sent
    assert robot.counts() == {"crowded_out": 300 - OTHERS}
    flooded(network, robot, "stranger", 1)  # there is room for it after that look
    assert [payload for _, payload in robot.drain()] == [b"strange"]


def test_all_is_taken_of_a_holder_with_a_long_name(network):
    endpoint, name = free_endpoint(), "n" * 100
    robot = network.robot(listen=(endpoint,), blocking=True)
    controller = network.controller(endpoint, who=name, blocking=True)
    known(robot, controller)
    grant(network, robot, controller.ask)
    for _ in range(5):
        controller.publish(b"setpoint")
    found: list[bytes] = []
    eventually(lambda: found.extend(p for _, p in robot.drain()) or len(found) == 5, "all of them")
    assert robot.counts() == {"crowded_out": 0}


def test_who_is_refused_authority_is_a_stranger_still(network):
    robot, controller = network.pair(blocking=True)
    answer = network.start(controller.ask, "acquire")
    (request,) = eventually(lambda: list(robot.requests()), "a request")
    request.answer({"granted": False, "reason": "held"})
    assert answer.result(PATIENCE_S)
    flooded(network, robot, "test", 50)
    assert len(robot.drain()) == OTHERS


def test_a_controller_that_comes_late_finds_the_newest_state_only(network):
    robot, controller = network.pair(blocking=True)
    told = robot._session.declare_publisher(
        key("arm", "done"),
        priority=zenoh.Priority.BACKGROUND,  # never overtakes a state
    )
    done = controller._session.declare_subscriber(key("arm", "done"))
    eventually(lambda: told.matching_status.matching)
    for number in range(50):
        robot.publish(b"%d" % number)
    told.put(b"")
    done.recv()
    assert next_state(controller)[1] == b"49"
    robot.publish(b"50")
    assert next_state(controller)[1] == b"50"


def test_a_waiting_controller_can_be_woken(network):
    robot, controller = network.pair()
    robot.publish(b"state")
    next_state(controller)
    waiting = network.start(controller.wait)
    controller.wake()
    assert waiting.result(PATIENCE_S) is None


def test_nobody_else_hears_the_waking(network):
    robot, controller = network.pair()
    states = robot._session.declare_subscriber(key("arm", "state"))
    marks = robot._session.declare_subscriber(key("arm", "mark"))
    mark = controller._session.declare_publisher(key("arm", "mark"))
    eventually(lambda: mark.matching_status.matching)
    controller.wake()
    mark.put(b"behind the waking")
    marks.recv()
    assert states.try_recv() is None


@pytest.mark.parametrize(
    ("verb", "content", "expected"),
    [
        ("description", b"any bytes", b"any bytes"),
        (
            "acquire",
            {"granted": True, "epoch": 2**53},
            b'{"granted": true, "epoch": 9007199254740992}',
        ),
        ("release", {"released": False}, b'{"released": false}'),
        ("status", {"holder": None}, b'{"holder": null}'),
        ("dance", {"error": "unknown"}, b'{"error": "unknown"}'),
    ],
)
def test_what_is_asked_is_answered_between_two_ticks(network, verb, content, expected):
    robot, controller = network.pair()
    answer = network.start(controller.ask, verb, PATIENCE_S)
    (request,) = eventually(lambda: list(robot.requests()), "a request")
    assert (request.verb, request.who) == (verb, "test")
    request.answer(content)
    assert answer.result(PATIENCE_S) == expected
    assert list(robot.requests()) == []


def test_who_gets_no_answer_in_time_gets_none_and_a_late_answer_harms_nobody(network):
    robot, controller = network.pair()
    assert controller.ask("status", timeout_s=0.05) is None
    (request,) = eventually(lambda: list(robot.requests()), "the request")
    request.answer({"mode": "idle"})
    answer = network.start(controller.ask, "status", PATIENCE_S)
    (request,) = eventually(lambda: list(robot.requests()), "the next request")
    request.answer(b"second")
    assert answer.result(PATIENCE_S) == b"second"


def test_an_answer_to_a_client_that_has_gone_harms_nobody(network):
    robot, _ = network.pair()
    session = open_session(LinkSettings(connect=(network.endpoint,), mode="client"))
    replies = session.get(key("arm", "ask/status/gone"), timeout=PATIENCE_S)
    (request,) = eventually(lambda: list(robot.requests()), "the request")
    session.close()
    request.answer({"mode": "idle"})
    assert [reply for reply in replies if reply.ok] == []


@pytest.mark.parametrize(
    ("selector", "verb"),
    [
        ("**", "**"),
        ("robots/**", "**"),
        ("robots/*/ask/*", "*"),
        ("*/arm/ask/status", "status"),
    ],
)
def test_a_wildcard_is_a_request_like_any_other(network, selector, verb):
    robot, controller = network.pair()
    every = zenoh.ConsolidationMode.NONE  # a wildcard may match the controller, which answers too
    replies = controller._session.get(
        selector, payload=b"x", timeout=PATIENCE_S, consolidation=every
    )
    (request,) = eventually(lambda: list(robot.requests()), "the request")
    assert request.verb == verb
    request.answer({"error": "unknown"})
    answers = [json.loads(reply.ok.payload.to_bytes()) for reply in replies if reply.ok]
    assert {"error": "unknown"} in answers


def test_what_a_controller_was_asked_is_dropped_once_nobody_waits_for_it(network):
    _, controller = network.pair()
    session = network.keep(open_session(LinkSettings(connect=(network.endpoint,), mode="client")))
    session.get(key("arm", "control/show"))
    eventually(lambda: controller._asked, "a request")
    asked_s, request = controller._asked.pop()
    controller._asked.extend([(asked_s - FRESH_S, request), (asked_s + PATIENCE_S, request)])
    assert controller.request() is request
    assert controller.request() is None
    controller._asked.append((asked_s - FRESH_S, request))
    assert controller.request() is None


@pytest.mark.parametrize(
    ("leaf", "who"), [("", ""), ("/Grüße", "Grüße"), ("/" + "x" * 1000, "x" * 64)]
)
def test_any_name_of_a_client_can_be_read(network, leaf, who):
    robot, controller = network.pair()
    replies = controller._session.get(key("arm", f"ask/acquire{leaf}"))
    (request,) = eventually(lambda: list(robot.requests()), "the request")
    assert request.who == who
    request.answer({})
    assert len(list(replies)) == 1


def gone(robot: ZenohRobotLink) -> Request:
    (request,) = eventually(lambda: list(robot.requests()), "a vanished client")
    return request


@pytest.mark.parametrize("who", ["alice-host-1", "Grüße", "x" * 64, "x" * 80])
def test_a_client_that_closes_is_gone_under_the_name_that_it_asks_with(network, who):
    endpoint = free_endpoint()
    robot = network.robot(listen=(endpoint,))
    link = ZenohControllerLink("arm", LinkSettings(connect=(endpoint,)), who)
    asking = network.start(link.ask, "acquire", PATIENCE_S)
    (request,) = eventually(lambda: list(robot.requests()), "the request")
    request.answer({})
    asking.result(PATIENCE_S)
    token_seen(robot, who)
    link.close()
    vanished = gone(robot)
    assert (vanished.verb, vanished.who) == ("gone", request.who)
    vanished.answer({"nobody": "listens"})


def test_a_client_that_is_killed_is_gone(network):
    endpoint = free_endpoint()
    robot = network.robot(listen=(endpoint,))
    child = subprocess.Popen(
        [sys.executable, str(VANISHING), endpoint, "arm", "victim"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(HERE.parent.parent)},
    )
    assert child.stdout.readline() == b"ready\n"
    token_seen(robot, "victim")
    assert list(robot.requests()) == []  # that it came is no request
    robot._clients.asks("victim")
    child.kill()
    assert (gone(robot).verb, child.wait()) == ("gone", -9)
    child.communicate()


def test_presence_follows_the_robot_and_wakes_the_controller(network):
    endpoint = free_endpoint()
    first = ZenohRobotLink("arm", LinkSettings(listen=(endpoint,)))
    controller = network.controller(endpoint)
    waiting = network.start(controller.wait)
    first.close()
    assert waiting.result(PATIENCE_S) is None  # it went
    assert not controller.presence.is_set()
    second = network.robot(listen=(endpoint,))
    came(controller)
    known(second, controller)
    second.publish(b"state of the second")
    assert next_state(controller)[1] == b"state of the second"


def test_no_robot_is_no_presence_and_no_answer(network):
    link = network.keep(
        ZenohControllerLink("arm", LinkSettings(connect=(free_endpoint(),)), "test")
    )
    assert not link.presence.is_set()
    assert link.ask("description", timeout_s=0.05) is None


def test_closing_the_robot_ends_its_threads(network):
    robot, _ = network.pair()
    threads = [robot._receiver, robot._answers._thread, robot._stop_answers._thread]
    assert all(thread.is_alive() for thread in threads)
    robot.close()
    assert not any(thread.is_alive() for thread in threads)


def test_a_second_robot_of_the_same_name_is_refused_and_leaves_nothing_behind(network):
    first, second = free_endpoint(), free_endpoint()
    network.robot(listen=(first,))
    with pytest.raises(NameTakenError, match="'arm'"):
        network.robot(listen=(second,), connect=(first,))
    network.robot("leg", listen=(second,), connect=(first,))


def test_robots_that_are_alive_are_listed(network):
    first, second = free_endpoint(), free_endpoint()
    network.robot("leg", listen=(first,))
    network.robot("arm", listen=(second,), connect=(first,))
    session = network.keep(open_session(LinkSettings(connect=(first, second))))
    eventually(lambda: alive_robots(session) == ["arm", "leg"], "both robots")


def test_a_port_that_something_else_uses_is_named(network):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        endpoint = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(PortInUseError, match=endpoint):
            network.robot(listen=(endpoint,))


@pytest.mark.slow
def test_a_client_finds_nobody_and_says_so():
    endpoint = free_endpoint()
    with pytest.raises(LinkError, match=endpoint):
        open_session(LinkSettings(connect=(endpoint,), mode="client"))


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1", "pigeon/roof", "tcp/198.51.100.1:9"])
def test_an_endpoint_that_cannot_be_is_named_without_paths_of_other_machines(endpoint):
    with pytest.raises(LinkError, match=rf"link.listen.*{endpoint}") as caught:
        open_session(LinkSettings(listen=(endpoint,), insecure=True))
    assert not isinstance(caught.value, PortInUseError)
    assert " at /" not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_where_the_link_cannot_be_built_the_session_is_closed_again(network):
    endpoint = free_endpoint()
    with pytest.raises(zenoh.ZError):
        ZenohRobotLink("not//a//name", LinkSettings(listen=(endpoint,)))
    network.robot(listen=(endpoint,))
    with pytest.raises(zenoh.ZError):
        ZenohControllerLink("arm", LinkSettings(connect=(endpoint,)), "not//a//name")


def test_only_the_configured_endpoint_on_loopback_listens(network):
    before = listening()
    endpoint = free_endpoint()
    robot = network.robot(listen=(endpoint,))
    controller = network.controller(endpoint)
    known(robot, controller)
    network.keep(open_session(LinkSettings(connect=(endpoint,), mode="client")))
    network.keep(open_session(LinkSettings()))
    port = int(endpoint.rpartition(":")[2])
    assert listening() - before == {("tcp", f"0100007F:{port:04X}")}


@pytest.mark.parametrize("side", ["state/2", "setpoint/us"])
def test_who_looks_on_gets_one_message_of_sixteen_ticks(network, side):
    robot, controller = network.pair(blocking=True)
    sender, looker = (robot, controller) if side == "state/2" else (controller, robot)
    message = State.allocate(q=2) if sender is robot else Setpoint.allocate(values=2)
    leaf = side if sender is robot else f"setpoint/{controller.who}"
    seen = looker._session.declare_subscriber(sampled_key("arm", leaf))
    eventually(lambda: sender._sampled.matching_status.matching)
    for tick in range(100):
        message.tick = tick
        sender.publish(message.dump())
        if tick % 16 == 0:  # one at a time: of a burst some may be dropped
            sample = eventually(seen.try_recv, f"tick {tick}")
            message.load(sample.payload.to_bytes())
            assert message.tick == tick
    assert seen.try_recv() is None


def test_events_of_one_moment_come_where_the_network_takes_nothing_for_a_while(network):
    """A stop, what it ends and its rest may be of one tick. Others' messages take all room."""
    endpoint = free_endpoint()
    robot = network.robot(listen=(endpoint,))
    events = [*map(str, range(EVENTS_AT_ONCE - 1)), "last"]
    child = subprocess.Popen([sys.executable, "-c", LISTENER, endpoint], stdout=subprocess.PIPE)
    try:
        assert child.stdout.readline() == b"ready\n"
        eventually(lambda: robot._events.matching_status.matching, "the subscription")
        child.send_signal(signal.SIGSTOP)
        for _ in range(FULL_BYTES // MAX_REQUEST_BYTES):
            robot._sampled.put(bytes(MAX_REQUEST_BYTES))
        for event in events:
            robot.announce(event.encode())
        child.send_signal(signal.SIGCONT)
        told, _ = child.communicate(timeout=PATIENCE_S)
    finally:
        child.kill()
        child.wait()
    assert told.decode().split() == events[:-1]


def test_who_looks_on_gets_a_state_once_it_is_answered_or_with_the_next(network):
    robot, controller = network.pair()
    state, setpoint = State.allocate(q=2), Setpoint.allocate(values=2)
    seen = controller._session.declare_subscriber(sampled_key("arm", "state/2"))
    eventually(lambda: robot._sampled.matching_status.matching)

    def publish(tick: int) -> None:
        state.tick = tick
        robot.publish(state.dump())

    def shown() -> int:
        state.load(eventually(seen.try_recv).payload.to_bytes())
        return state.tick

    publish(0)
    assert robot._to_show  # it waits
    controller.publish(setpoint.dump())
    assert shown() == 0
    publish(16)
    assert robot._to_show
    publish(17)
    assert shown() == 16
