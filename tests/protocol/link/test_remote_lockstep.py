"""Lockstep over real sessions: each State waits for its answer, however long that takes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest
from loopback import PATIENCE_S, Network, eventually, free_endpoint, known, next_state, token_seen

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.errors import LinkError
from hoap3.protocol.link import remote_lockstep
from hoap3.protocol.link.base import Request
from hoap3.protocol.link.local_control import LocalControl, local_robots
from hoap3.protocol.link.remote_lockstep import RemoteLockstepLink
from hoap3.protocol.link.zenoh_link import ZenohControllerLink, ZenohRobotLink, key
from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.runtime.clock import VirtualClock

COMPUTE_TIME = 300_000


class Bench:
    """A robot's link in lockstep, and a controller's link that a test answers by hand."""

    def __init__(self, network: Network, *, endless: bool = False) -> None:
        self.clock = VirtualClock()
        self.stopped = False
        endpoint = free_endpoint()
        self.robot = network.keep(
            RemoteLockstepLink(
                ZenohRobotLink("arm", LinkSettings(listen=(endpoint,)), blocking=True),
                self.clock,
                COMPUTE_TIME,
                lambda: self.stopped,
                endless=endless,
            )
        )
        self.controller: ZenohControllerLink = network.controller(endpoint, blocking=True)
        known(self.robot._inner, self.controller)
        self._network = network

    def publish(self, tick: int, mode: int = State.ACTIVE):
        """Publish a State in the background: it returns when it has been answered."""
        return self._network.start(self.robot.publish, state(tick, mode))


@pytest.fixture
def bench(network) -> Bench:
    return Bench(network)


def state(tick: int, mode: int = State.ACTIVE) -> bytes:
    message = State(2)
    message.tick, message.mode = tick, mode
    return message.dump()


def setpoint(tick: int, *, mark: float = 0.0) -> bytes:
    message = Setpoint(2)
    message.tick, message.values[0] = tick, mark
    return message.dump()


def test_an_answer_flies_for_its_compute_time(bench):
    published = bench.publish(7)
    assert next_state(bench.controller)[1] == state(7)
    assert not published.done()
    bench.controller.publish(setpoint(7))
    published.result(PATIENCE_S)
    bench.clock.advance(COMPUTE_TIME - 1)
    assert bench.robot.drain() == []
    bench.clock.advance(1)
    assert bench.robot.drain() == [(COMPUTE_TIME, setpoint(7))]


def test_a_state_is_repeated_with_the_same_bytes_until_it_is_answered(bench):
    published = bench.publish(7)
    seen = [next_state(bench.controller)[1] for _ in range(4)]
    assert seen == [state(7)] * 4
    assert not published.done()
    bench.controller.publish(setpoint(7))
    published.result(PATIENCE_S)
    bench.clock.advance(COMPUTE_TIME)
    assert len(bench.robot.drain()) == 1


def test_a_repeated_tick_that_is_answered_again_answers_no_later_one(bench, network):
    """The same bytes again count as nothing; others go to the robot, which counts them."""
    give_authority(bench, network, "test")  # of others, few answers at once are taken
    published = bench.publish(7)
    repeated = [next_state(bench.controller) for _ in range(3)]
    for _ in repeated:
        bench.controller.publish(setpoint(7, mark=1.0))
    published.result(PATIENCE_S)
    published = bench.publish(8)
    while next_state(bench.controller)[1] != state(8):
        pass
    bench.controller.publish(setpoint(7, mark=2.0))
    bench.controller.publish(setpoint(8, mark=3.0))
    published.result(PATIENCE_S)
    bench.clock.advance(COMPUTE_TIME)
    found = [payload for _, payload in bench.robot.drain()]
    assert found == [setpoint(7, mark=1.0), setpoint(7, mark=2.0), setpoint(8, mark=3.0)]


def test_what_is_no_answer_to_this_tick_does_not_end_the_waiting(bench, network):
    give_authority(bench, network, "test")
    published = bench.publish(7)
    next_state(bench.controller)
    others = [b"", b"garbage", setpoint(6), setpoint(8), Event().dump()]
    for payload in others:
        bench.controller.publish(payload)
    bench.controller.publish(setpoint(7))
    published.result(PATIENCE_S)
    bench.clock.advance(COMPUTE_TIME)
    found = [payload for _, payload in bench.robot.drain()]
    assert found == [*others, setpoint(7)]


@pytest.mark.parametrize("stopped", [True, False])
def test_an_answer_just_before_a_release_or_a_stop_arrives_at_its_tick(stopped):
    """The answer comes after the link looked for answers."""

    class Inner:
        def __init__(self) -> None:
            self.answers: list[tuple[int, bytes]] = []
            self.arrival = self

        def publish(self, payload: bytes) -> None:
            pass

        def wait(self, timeout: float) -> None:
            if stopped:
                self.answers.append((0, setpoint(7)))

        def clear(self) -> None:
            pass

        def requests(self) -> Iterator[Request]:
            self.answers.append((0, setpoint(7)))
            yield Request("release", "test", lambda answer: None)

        def drain(self) -> list[tuple[int, bytes]]:
            found, self.answers = self.answers, []
            return found

    clock = VirtualClock()
    robot = RemoteLockstepLink(Inner(), clock, COMPUTE_TIME, lambda: stopped)
    robot._holder = "test"
    robot.publish(state(7))
    clock.advance(1_000_000)
    assert robot.drain() == [(COMPUTE_TIME, setpoint(7))]


@pytest.mark.parametrize("mode", [State.IDLE, State.STOPPING, State.STOPPED])
def test_a_state_that_does_not_ask_is_not_waited_for(bench, mode):
    bench.robot.publish(state(7, mode))
    assert next_state(bench.controller)[1] == state(7, mode)
    bench.clock.advance(COMPUTE_TIME)
    assert bench.robot.drain() == []


def test_no_answer_at_all_is_an_error_that_names_the_tick(bench, monkeypatch):
    monkeypatch.setattr(remote_lockstep, "GIVE_UP_S", 0.12)
    with pytest.raises(LinkError, match="tick 7"):
        bench.robot.publish(state(7))


def test_who_is_told_to_stop_waits_no_longer(bench):
    published = bench.publish(7)
    next_state(bench.controller)
    bench.stopped = True
    published.result(PATIENCE_S)
    bench.clock.advance(COMPUTE_TIME)
    assert bench.robot.drain() == []


def test_time_goes_on_without_an_answer_where_the_holder_leaves(bench, network):
    give_authority(bench, network, "test")
    published = bench.publish(7)
    next_state(bench.controller)
    asked = network.start(bench.controller.ask, "release", PATIENCE_S)
    published.result(PATIENCE_S)
    assert served(bench.robot) == ["release"]
    assert asked.result(PATIENCE_S) == b"{}"
    bench.clock.advance(COMPUTE_TIME)
    assert bench.robot.drain() == []


def test_time_goes_on_without_an_answer_where_the_holder_vanishes(bench, network):
    give_authority(bench, network, "test")
    token_seen(bench.robot._inner, "test")
    published = bench.publish(7)
    next_state(bench.controller)
    bench.controller.close()
    published.result(PATIENCE_S)
    assert served(bench.robot) == ["gone"]


@pytest.mark.parametrize("verb", ["release", "stop"])
def test_time_goes_on_without_an_answer_where_the_machines_own_user_says_so(bench, network, verb):
    with closing(LocalControl("arm", ())) as local:
        bench.robot.serve_also(local)
        give_authority(bench, network, "test")
        published = bench.publish(7)
        next_state(bench.controller)
        (robot,) = local_robots()
        asked = network.start(robot.ask, verb)
        published.result(PATIENCE_S)
        assert served(bench.robot) == [verb]
        assert asked.result(PATIENCE_S)["robot"] == "arm"


def test_what_others_ask_meanwhile_waits_for_the_answer_with_the_state(bench, network):
    give_authority(bench, network, "test")
    published = bench.publish(7)
    next_state(bench.controller)
    session = bench.controller._session
    for who in ("somebody else", "another"):
        session.get(key("arm", f"ask/release/{who}"))
    session.get(key("arm", "ask/stop/test"))
    eventually(lambda: len(bench.robot._waiting) == 3, "the requests")
    next_state(bench.controller)  # it is still repeated
    bench.controller.publish(setpoint(7))
    published.result(PATIENCE_S)
    assert sorted(served(bench.robot)) == ["release", "release", "stop"]
    bench.clock.advance(COMPUTE_TIME)
    assert len(bench.robot.drain()) == 1


ANSWERS = {"acquire": {"granted": True}, "recover": {"recovered": True}}


def served(robot: RemoteLockstepLink, answers: dict[str, dict] | None = None) -> list[str]:
    """Verbs of the requests of one tick, each answered."""
    verbs = []
    for request in robot.requests():
        verbs.append(request.verb)
        request.answer((ANSWERS if answers is None else answers).get(request.verb, {}))
    return verbs


def give_authority(bench: Bench, network: Network, who: str) -> None:
    """Let the controller acquire."""
    assert bench.controller.who == who
    first = network.start(served, bench.robot)
    bench.controller.ask("acquire", PATIENCE_S)
    assert first.result(PATIENCE_S) == ["acquire"]


@pytest.mark.parametrize("verb", ["acquire", "recover"])
def test_at_first_time_stands_still_until_somebody_gets_what_moves_it(bench, network, verb):
    first = network.start(served, bench.robot)
    assert bench.controller.ask("status", PATIENCE_S) == b"{}"
    assert bench.controller.ask("stop", PATIENCE_S) == b"{}"
    assert not first.done()
    bench.controller.ask(verb, PATIENCE_S)
    assert first.result(PATIENCE_S) == ["status", "stop", verb]
    assert served(bench.robot) == []  # from now on, a tick waits for nobody


def test_a_refusal_does_not_move_time(bench, network):
    refusals = {"acquire": {"granted": False}, "recover": {"recovered": False}}
    first = network.start(served, bench.robot, refusals)
    assert bench.controller.ask("acquire", PATIENCE_S) == b'{"granted": false}'
    assert bench.controller.ask("recover", PATIENCE_S) == b'{"recovered": false}'
    assert not first.done()
    bench.stopped = True
    assert first.result(PATIENCE_S) == ["acquire", "recover"]


def test_later_ticks_serve_what_has_come(bench, network):
    give_authority(bench, network, "test")
    stop = network.start(bench.controller.ask, "stop", PATIENCE_S)
    assert eventually(lambda: served(bench.robot), "the request") == ["stop"]
    assert stop.result(PATIENCE_S) == b"{}"


@pytest.mark.parametrize("mode", [State.IDLE, State.STOPPED])
def test_a_robot_without_end_stands_still_again_at_rest(network, mode):
    bench = Bench(network, endless=True)
    give_authority(bench, network, "test")
    bench.robot.publish(state(7, State.STOPPING))
    assert served(bench.robot) == []
    bench.robot.publish(state(8, mode))
    give_authority(bench, network, "test")
    assert served(bench.robot) == []


def test_a_robot_with_an_end_goes_on_at_rest(bench, network):
    give_authority(bench, network, "test")
    bench.robot.publish(state(7, State.STOPPED))
    assert served(bench.robot) == []


def test_who_is_told_to_stop_waits_for_nobody_to_ask(bench):
    bench.stopped = True
    assert served(bench.robot) == []


def test_a_stray_setpoint_does_not_keep_the_waiting_robot_busy(bench):
    arrival = bench.robot._inner.arrival
    bench.controller.publish(setpoint(1))
    assert arrival.wait(PATIENCE_S)
    asked = iter([False, True, True])
    bench.robot._should_stop = lambda: next(asked)
    assert served(bench.robot) == []
    assert not arrival.is_set()


def test_events_are_sent(bench):
    events = bench.controller._session.declare_subscriber(key("arm", "events"))
    publisher = bench.robot._inner._events
    eventually(lambda: publisher.matching_status.matching, "a subscriber to events")
    bench.robot.announce(Event().dump())
    assert events.recv().payload.to_bytes() == Event().dump()


def test_many_ticks_with_a_controller_that_repeats_itself_as_ours_does(bench, network):
    ticks = 300

    def controller() -> int:
        answered, last, answer = 0, -1, b""
        while last < ticks - 1:
            (tick,) = State.scalars(next_state(bench.controller)[1], "tick")
            if tick != last:
                last, answer, answered = tick, setpoint(tick, mark=tick), answered + 1
            bench.controller.publish(answer)
        return answered

    following = network.start(controller)
    found = []
    for tick in range(ticks):
        found += bench.robot.drain()
        bench.robot.publish(state(tick))
        bench.clock.advance(1_000_000)
    found += bench.robot.drain()
    assert following.result(PATIENCE_S) == ticks
    assert found == [
        (tick * 1_000_000 + COMPUTE_TIME, setpoint(tick, mark=tick)) for tick in range(ticks)
    ]
