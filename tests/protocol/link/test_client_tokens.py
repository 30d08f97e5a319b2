"""Authority is held by clients that are alive: what comes of tokens, requests and their order.

The robot is stepped by hand. While it is not, requests and the news of clients that come and go
wait together, as they do when its process is held up.
"""

from __future__ import annotations

import json
import random
from collections import deque
from collections.abc import Callable
from typing import Any

import pytest
import zenoh
from loopback import Network, eventually, free_endpoint
from support.small_arm import arm

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link import zenoh_clients
from hoap3.protocol.link.client_tokens import MAX_CLIENTS
from hoap3.protocol.link.zenoh_session import key, open_session
from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.realtime import Ticker
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.loop import EVENTS, REQUESTS_PER_TICK, RobotLoop

LEASE_TICKS = LinkSettings().lease_ms
WAITING = 40  # requests in front of another; the robot's queue takes 64


@pytest.fixture(autouse=True)
def _hurry(monkeypatch):
    monkeypatch.setattr(zenoh_clients, "LOOK_PAUSE_S", 0.0)


class Client:
    """A session that asks for authority by hand."""

    def __init__(self, bench: Bench, who: str, *, token: bool = True) -> None:
        self._bench, self.who = bench, who
        settings = LinkSettings(connect=(bench.endpoint,), mode="client")
        self.session = bench.network.keep(open_session(settings))
        self.answers = self.token = None
        if token:
            self.hold()

    def hold(self) -> None:
        """Declare the token."""
        self.token = self.session.liveliness().declare_token(key("arm", f"clients/{self.who}"))

    def ask(self, verb: str = "acquire") -> None:
        """Ask, and see the request wait at the robot."""
        before = self._bench.waiting()
        self.answers = self.session.get(
            key("arm", f"ask/{verb}/{self.who}"), zenoh.handlers.FifoChannel(1)
        )
        eventually(lambda: self._bench.waiting() > before, "the request")

    def die(self) -> None:
        """Vanish, and see the news of that wait at the robot."""
        self.session.close()
        if self.token:
            eventually(lambda: self._bench.has_gone(self.who), "the end of a client")

    def answer(self) -> dict:
        """What the robot answers in one of its next ticks."""
        return json.loads(eventually(self._answered, "an answer"))

    def granted(self) -> bool:
        self.ask()
        return self.answer()["granted"]

    def _answered(self) -> bytes | None:
        self._bench.step()
        reply = self.answers.try_recv()
        return reply.ok.payload.to_bytes() if reply else None


class Gathered:
    """A queue of which a test can see what waits in it."""

    def __init__(self, queue: Any) -> None:
        self._queue, self._items = queue, deque()

    def gather(self) -> deque[Any]:
        while (item := self._queue.try_recv()) is not None:
            self._items.append(item)
        return self._items

    def try_recv(self, **_: bool) -> Any:
        return self.gather().popleft() if self.gather() else None

    def is_stop(self, query: Any) -> bool:
        return bool(self._queue.is_stop(query))


class Bench:
    """A robot on virtual time whose clients are real sessions."""

    def __init__(self, network: Network) -> None:
        self.network, self.endpoint = network, free_endpoint()
        self.link = network.robot(listen=(self.endpoint,))
        self.clock, self.recorder = VirtualClock(), MemoryRecorder()
        config = EmulatorConfig(robot="arm", misses_to_stop=10**9)
        self.robot = RobotLoop(arm(), config, self.clock, self.link, self.recorder, session_id=7)
        self.robot._requests_per_tick = REQUESTS_PER_TICK
        self._ticker = Ticker(self.clock, self.robot.period, 0)
        self.link._queries = self.queries = Gathered(self.link._queries)
        clients = self.link._clients
        clients._samples = self.samples = Gathered(clients._samples)

    def waiting(self) -> int:
        """Requests that have arrived and are not served."""
        return len(self.queries.gather())

    def has_gone(self, who: str) -> bool:
        """Whether the news that a client's token has gone waits for the robot."""
        return any(
            sample.kind == zenoh.SampleKind.DELETE and str(sample.key_expr).endswith(f"/{who}")
            for sample in self.samples.gather()
        )

    def tokens(self) -> set[str]:
        replies = self.link._session.liveliness().get(key("arm", "clients/*"))
        return {str(reply.ok.key_expr).rpartition("/")[2] for reply in replies if reply.ok}

    def step(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            self._ticker.wait()
            self.robot.step(self._ticker)

    def step_until(self, condition: Callable[[], object], what: str) -> None:
        eventually(lambda: self.step() or condition(), what)

    @property
    def holder(self) -> str | None:
        grant = self.robot._authority.grant
        return grant.holder if grant else None

    def events(self) -> list[int]:
        return [
            Event.scalars(record.payload, "kind")[0]
            for record in self.recorder.records
            if record.kind == Kind.EVENT
        ]


@pytest.fixture
def bench(network) -> Bench:
    return Bench(network)


@pytest.mark.parametrize("queue", [0, WAITING])
@pytest.mark.parametrize("first", ["token", "request"])
def test_who_asks_and_dies_before_it_is_served_gets_nothing(bench, queue, first):
    other, victim = Client(bench, "other"), Client(bench, "victim", token=first == "token")
    for _ in range(queue):
        other.ask("status")
    victim.ask()
    if first == "request":
        victim.hold()
        eventually(lambda: "victim" in bench.tokens(), "the token")
    victim.die()
    bench.step(queue // REQUESTS_PER_TICK + 2)
    assert bench.waiting() == 0
    assert bench.holder is None
    assert other.granted()


def test_a_holder_that_dies_behind_a_queue_of_requests_is_lost(bench):
    other, victim = Client(bench, "other"), Client(bench, "victim")
    assert victim.granted()
    for _ in range(WAITING):
        other.ask("status")
    victim.die()
    bench.step(WAITING // REQUESTS_PER_TICK + 2)
    assert bench.holder is None
    assert EVENTS["HOLDER_LOST"] in bench.events()


def test_without_a_token_authority_is_refused_and_with_one_it_is_granted(bench):
    client = Client(bench, "late", token=False)
    client.ask()
    answer = client.answer()
    assert (answer["granted"], answer["reason"], answer["holder"]) == (False, "no_token", None)
    client.hold()
    assert client.granted()


def test_a_wildcard_is_nobody_whose_token_is_seen(bench):
    Client(bench, "alive")
    wild = Client(bench, "*", token=False)
    for _ in range(3):
        assert not wild.granted()
        bench.step(LEASE_TICKS)
    assert bench.holder is None


def test_a_request_is_not_forgotten_where_many_clients_vanish_in_the_same_tick(bench):
    """No more than some requests are served in a tick, vanished clients among them."""
    clients = [Client(bench, f"client{number}") for number in range(2 * REQUESTS_PER_TICK)]
    for client in clients:
        client.ask()
    bench.step(len(clients))
    last = Client(bench, "last")
    last.ask()
    for client in clients:
        client.die()
    assert last.answer()["granted"]


def test_a_holder_is_looked_up_each_lease_should_the_news_of_its_end_be_lost(bench):
    ghost = Client(bench, "ghost", token=False)
    bench.link._clients._known.seen["ghost"] = 0  # as if it had gone without a word
    assert ghost.granted()
    bench.step(LEASE_TICKS - bench.robot.tick)
    assert bench.holder == "ghost"
    bench.step_until(lambda: bench.holder is None, "the look-up")
    assert EVENTS["HOLDER_LOST"] in bench.events()


@pytest.mark.parametrize("verb", ["acquire", "recover"])
def test_a_holder_is_looked_up_after_a_refusal_and_after_a_recovery(bench, verb):
    other, ghost = Client(bench, "other"), Client(bench, "ghost", token=False)
    bench.link._clients._known.seen["ghost"] = 0
    bench.robot._lease_ticks = 10**9
    assert ghost.granted()
    other.ask(verb)
    other.answer()
    bench.step_until(lambda: bench.holder is None, "the look-up")


def test_a_token_whose_news_was_lost_is_found_after_a_refusal(bench):
    client = Client(bench, "unseen")
    bench.step_until(lambda: "unseen" in bench.link._clients._known.seen, "the token")
    bench.link._clients._known.seen.clear()
    client.ask()
    assert client.answer()["reason"] == "no_token"
    bench.step_until(lambda: "unseen" in bench.link._clients._known.seen, "the look-up")
    assert client.granted()


def test_two_sessions_of_one_name_are_one_client_until_both_have_gone(bench):
    first, second = Client(bench, "twin"), Client(bench, "twin")
    assert first.granted()
    assert second.granted()
    first.session.close()
    bench.step(LEASE_TICKS)
    assert bench.holder == "twin"
    second.die()
    bench.step()
    assert bench.holder is None


def test_of_many_tokens_the_oldest_are_forgotten_and_found_again(bench):
    oldest, crowd = Client(bench, "oldest"), Client(bench, "crowd", token=False)
    bench.step_until(lambda: "oldest" in bench.link._clients._known.seen, "the token")
    held = []
    for number in range(MAX_CLIENTS):
        token = crowd.session.liveliness().declare_token(key("arm", f"clients/{number}"))
        held.append(token)
        if number % 64 == 0:
            bench.step_until(lambda: str(number) in bench.link._clients._known.seen, "a token")  # noqa: B023
    bench.step_until(lambda: str(number) in bench.link._clients._known.seen, "the last token")
    assert len(bench.link._clients._known.seen) == MAX_CLIENTS
    assert "oldest" not in bench.link._clients._known.seen
    assert not oldest.granted()
    bench.step_until(lambda: "oldest" in bench.link._clients._known.seen, "the look-up")
    assert oldest.granted()


def test_tokens_that_nobody_takes_hold_up_no_setpoint(bench):
    crowd, names = Client(bench, "crowd", token=False), [f"name{number}" for number in range(600)]
    liveliness = crowd.session.liveliness()
    held = [liveliness.declare_token(key("arm", f"clients/{name}")) for name in names]
    crowd.session.put(key("arm", "setpoint"), b"behind them")
    assert eventually(bench.link.drain, "the setpoint")[0][1] == b"behind them"
    assert len(held) == len(names)


@pytest.mark.parametrize("seed", range(5))
def test_whatever_clients_do_in_whatever_order_nobody_who_is_dead_holds_authority(bench, seed):
    choice = random.Random(seed)
    alive: list[Client] = []
    for number in range(40):
        match choice.choice(("come", "ask", "die", "step", "step")):
            case "come" if len(alive) < 5:
                alive.append(Client(bench, f"client{number}", token=choice.random() < 0.8))
            case "ask" if alive:
                choice.choice(alive).ask()
            case "die" if alive:
                alive.pop(choice.randrange(len(alive))).die()
            case "step":
                bench.step()
    bench.step(40)  # all that was asked is served
    assert bench.waiting() == 0
    assert bench.holder in {None, *(client.who for client in alive if client.token)}
    for client in alive:
        client.die()
    bench.step(40)
    assert bench.holder is None
    assert Client(bench, "next").granted()
