"""Queries of all kinds to a robot and to its controller: each has an answer, and both go on."""

from __future__ import annotations

import json
import random
from typing import Any

import pytest
import yaml
from fuzzing import (
    Findings,
    amount,
    corpus,
    mutate_bytes,
    mutate_tree,
)
from support.robot_bench import Bench
from wire_mutations import LONGS, REALS, WORDS

from hoap3.protocol.answers import MAX_CONTROL_BYTES, ROBOT_ANSWERS, ControlAnswer, parse_answer
from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import Hoap3Error, UsageError, WireError
from hoap3.protocol.link.base import Request
from hoap3.protocol.messages import State
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.recorder import NoRecorder
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.loop import ControllerLoop
from hoap3.remote_controller.service import serve
from hoap3.robot_emulator.robots import load

VERBS = corpus("queries")[0].decode().split()
CHANGES: list[Any] = json.loads(corpus("changes")[0])
CONTROLLERS = {yaml.safe_load(data)["controller"]: data for data in corpus("controllers")}
COUNTS = ("skipped", "late", "rejected", "epoch_from_tick")
SESSION = 7


class Wrong(Exception):  # noqa: N818 - what is found, not an error of the product
    """The product answered what it should not."""


def strange_text(draw: random.Random, known: list[str]) -> str:
    """A word that is known, or something else."""
    word = draw.choice(known)
    return draw.choice(
        (
            word,
            word,
            word,
            word.upper(),
            word[1:],
            f"{word}/x",
            "",
            "\0",
            "é" * 40,
            "x" * 300,
            "*",
            "**",
        )
    )


def body_of(draw: random.Random, tree: Any) -> bytes:
    """JSON of something like that, or bytes that are none."""
    match draw.randrange(5):
        case 0:
            return mutate_bytes(draw, json.dumps(tree).encode())
        case 1:
            return draw.choice(
                (b"", b"\xff\xfe", b"[" * 50_000, b'{"a":' * 20_000, b"9" * 5000, b"NaN")
            )
        case _:
            return json.dumps(mutate_tree(draw, tree)).encode()


@amount(80)
def test_a_robot_answers_every_query(
    count: int,
    findings: Findings,
) -> None:
    draw, bench = random.Random(count), Bench(grace=2)
    whos = ["a", "b", "test"]

    def decode(given: bytes) -> None:
        verb, who, body, present, local = asked
        answers = bench.link.ask(verb, who, body, present=present, local=local)
        bench.ticker.wait()
        bench.robot.step(bench.ticker)
        if len(answers) != 1:
            raise Wrong(f"{len(answers)} answers to {verb!r}")
        raw = answers[0] if isinstance(answers[0], bytes) else json.dumps(answers[0]).encode()
        if verb in ROBOT_ANSWERS:
            parse_answer(ROBOT_ANSWERS[verb], raw, "robot")
        else:
            found = json.loads(raw)
            if set(found) == {"error"}:
                raise UsageError(found["error"])

    for _ in range(count):
        body = body_of(draw, CHANGES[0])
        asked = (
            strange_text(draw, VERBS),
            strange_text(draw, whos)[:64],
            body * (draw.choice((1, 1, 1, 400)) if len(body) < 1000 else 1),
            draw.random() < 0.8,
            draw.random() < 0.1,
        )
        findings.judge(decode, repr((*asked[:2], body[:1000], *asked[3:])))
    findings.check(count)
    bench.link.ask("recover", "test")
    bench.run(5)
    assert bench.link.ask("status") is not None


class Followed:
    """A controller that a robot follows, and what asks of it is served as its service does."""

    def __init__(self, data: bytes) -> None:
        config = parse(ControllerConfig, yaml.safe_load(data), "config")
        self.description = load(config.robot)
        self.clock = VirtualClock(1_000)
        self.controller = build(config, self.description, "config")
        self.loop = ControllerLoop(self.controller, self.clock, NoRecorder(), SESSION)
        self.loop.grant(1)
        self._state = State.allocate(**self.description.state_lengths)
        self._state.session_id, self._state.epoch, self._state.mode = SESSION, 1, State.ACTIVE
        self._state.q[:] = self._state.reference[:] = self.description.initial_position
        self.step()

    def step(self) -> None:
        """Answer a State."""
        state = self._state
        state.tick += 1
        self.clock.advance(1_000_000)
        if self.loop.answer(self.clock.now(), state.dump()) is None and not self.silent:
            raise Wrong("it answers no more")
        self.loop.sent()

    def strange_state(self, draw: random.Random) -> bytes:
        """The next State with some fields, numbers or bytes that are others."""
        state = State.like(self._state.dump())
        state.load(self._state.dump())
        self._state.tick += 1
        state.tick = self._state.tick
        for _ in range(draw.choice((1, 1, 3))):
            name = draw.choice(("q", "dq", "tau", "reference", *COUNTS, "stamp", "mode"))
            if name == "mode":
                state.mode, state.epoch = draw.choice(WORDS), draw.choice((1, 1, 2))
            elif name == "stamp":
                state.stamp_published = draw.choice(LONGS) - 2**63
            elif name in COUNTS:
                setattr(state, name, draw.choice(LONGS))
            elif getattr(state, name).size:
                array = getattr(state, name)
                array[draw.randrange(array.size)] = draw.choice(REALS)
        payload = state.dump()
        if draw.random() < 0.8:
            return payload
        other = mutate_bytes(draw, payload)
        return other[:20] + payload[20:28] + other[28:]  # of a later tick all others would be old

    def receive_event(self, payload: bytes) -> None:
        """Take a State of whomever; an error of ours would end the controller."""
        rejected = self.loop.rejected
        try:
            self.loop.answer(self.clock.now(), payload)
            self.loop.sent()
        except Hoap3Error as error:
            raise Wrong(f"ends the controller: {error}") from error
        if self.loop.rejected > rejected:
            raise WireError("state", "refused")

    @property
    def silent(self) -> bool:
        return self.loop.steering.silent(self._state.tick)

    def ask(self, verb: str, who: str, body: bytes) -> dict[str, Any]:
        """What its service answers; an error of ours from there would end the controller."""
        answers: list[Any] = []
        request = Request(verb, who, answers.append, body)
        try:
            serve(request, self.loop, json.dumps({"error": None, "now": {}}).encode())
            self.step()
        except Hoap3Error as error:
            raise Wrong(f"ends the controller: {error}") from error
        raw = answers[0] if isinstance(answers[0], bytes) else json.dumps(answers[0]).encode()
        answer = parse_answer(ControlAnswer, raw, "controller", MAX_CONTROL_BYTES)
        if answer.error is not None:
            raise UsageError(answer.error)
        return answer.now or {}


@pytest.fixture(scope="module", params=sorted(CONTROLLERS))
def followed(request: pytest.FixtureRequest) -> Followed:
    return Followed(CONTROLLERS[request.param])


def shape_of(followed: Followed) -> list[Any]:
    """Changes that fit: of its own numbers, as it tells them."""
    numbers = followed.controller.numbers()
    shown = followed.loop.changeable()
    return [*CHANGES, shown, *({each["key"]: each["lower"] or 1.0} for each in numbers)]


@pytest.mark.parametrize(
    "count", [pytest.param(150, marks=pytest.mark.slow), pytest.param(2500, marks=pytest.mark.long)]
)
def test_a_controller_answers_every_query_and_goes_on(
    followed: Followed,
    count: int,
    findings: Findings,
) -> None:
    draw, fitting = random.Random(count), shape_of(followed)
    taken = 0

    def decode(given: bytes) -> None:
        nonlocal taken
        followed.ask(verb, who, body)
        taken += verb == "change"

    verb, who = "change", "a"
    for change in fitting:
        body = json.dumps(change).encode()
        findings.judge(decode, body)
    for _ in range(count):
        verb = draw.choice((*VERBS[8:], "change", "change", "change", "acquire", "release"))
        who = strange_text(draw, ["a", "b"])
        body = body_of(draw, draw.choice(fitting))
        findings.judge(decode, body[:2000])
    findings.check(count + len(fitting))
    assert taken > 0


@pytest.mark.parametrize(
    "count", [pytest.param(150, marks=pytest.mark.slow), pytest.param(2500, marks=pytest.mark.long)]
)
def test_a_controller_outlives_every_state(
    followed: Followed,
    count: int,
    findings: Findings,
) -> None:
    """Anybody may send States in plain mode."""
    draw = random.Random(count)
    for _ in range(count):
        findings.judge(followed.receive_event, followed.strange_state(draw))
        followed.step()
    findings.check(count)


@amount(100)
def test_an_answer_of_a_robot_is_taken_or_refused(
    count: int,
    findings: Findings,
) -> None:
    draw = random.Random(count)
    status = {"mode": "idle", "holder": None, "session_id": 7, "tick": 3, "lockstep": False}
    good: dict[str, dict[str, Any]] = {
        "status": status,
        "stop": {**status, "mode": "stopping", "stop_reason": "command"},
        "recover": {**status, "recovered": True},
        "release": {"released": True},
        "acquire": {**status, "granted": True, "epoch": 1, "from_tick": 23, "delay_ticks": 2},
    }
    for _ in range(count):
        verb = draw.choice(list(good))

        def decode(raw: bytes, verb: str = verb) -> None:
            parse_answer(ROBOT_ANSWERS[verb], raw, f"robot 'arm' answers {verb!r}")

        findings.judge(decode, body_of(draw, good[verb]))
    findings.check(count)
