"""The page's websocket: words of all kinds, with and without the right code, and raw bytes."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import json
import random
import socket
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest
from fuzzing import (
    Findings,
    amount,
    corpus,
    mutate_bytes,
    mutate_tree,
)
from support.pages.view_bench import NotingOperator, Served, StillSource, page

import hoap3
from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import State
from hoap3.tools.view import page as page_module
from hoap3.tools.view.access import Gate, new_token
from hoap3.tools.view.page import Page
from hoap3.tools.view.picture.frame import Frames
from hoap3.tools.view.picture.geometry import Looks
from hoap3.tools.view.sources.play_clock import PlayClock
from hoap3.tools.view.steering.operator import Operator

WORDS: list[dict[str, Any]] = json.loads(corpus("page")[0])
UR5 = hoap3.load_robot("ur5")
BOUNDS = {"speed": [0.25] * 3, "acceleration": [1.0] * 3, "jerk": [20.0] * 3}
HAND = {"name": "hand", "dimension": 3, "rates": 3, "layout": [*"xyz"], "unit": "m", **BOUNDS}
ORIGIN = "http://here"


class Robot:
    """Stands for a connection; does whatever it is told."""

    who = "us"

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: {"refused": {}, "recovered": True}


class Wire:
    """Stands for a websocket; keeps what was sent."""

    def __init__(self) -> None:
        self.sent: list[dict[str, Any]] = []

    async def send(self, message: str) -> None:
        self.sent.append(json.loads(message))

    async def close(self, code: int = 1000, reason: str = "") -> None:
        """Nothing is closed."""


class Player:
    """A place in a log that is nowhere."""

    def __init__(self) -> None:
        clock = PlayClock(lambda: 0.0)
        self.seek, self.play = clock.go, clock.run


def operator() -> Operator:
    """One of a robot that takes all, with a live target."""
    parameters = {"frame": "tool0", "target": {"kind": "live", "name": "hand"}}
    tasks = [{"task": "frame_position", "parameters": parameters}]
    about = {"config": {"parameters": {"tasks": tasks}}, "targets": [HAND]}
    state = State.allocate(**UR5.state_lengths)
    state.q[:] = state.reference[:] = UR5.initial_position
    source: Any = SimpleNamespace(
        frames=Frames(UR5, Looks({}), about),
        stop=dict,
        newest=lambda: SimpleNamespace(state=state),
        operator=None,
        robot="ur5",
        endpoint="",
        look_again=lambda: None,
        changed=lambda over_s: None,
        changeable=list,
    )
    return Operator(source, lambda event: None, lambda *_: Robot())  # type: ignore[arg-type, return-value]


class Hand:
    """Says words to a page's other end, with the right code where it wants to."""

    def __init__(self, draw: random.Random, token: str) -> None:
        self.wire, self._draw, self._token = Wire(), draw, token
        self._visit = Gate(token, "here", 80).visit(ORIGIN)
        self._number = 0
        self.operator = operator()
        self.page = Page(self.wire, self._visit, self.operator, Player())

    def _code(self, text: str) -> str:
        raw = text.encode("utf-8", "surrogatepass")
        return hmac.new(self._token.encode(), raw, hashlib.sha256).hexdigest()

    def word(self) -> str | bytes:
        """Something to say; the page has proved the token, four times of five."""
        draw, visit = self._draw, self._visit
        if draw.random() < 0.8 and not visit.proved:
            visit.prove(self._code(visit.nonce + ORIGIN))
        word = json.loads(json.dumps(draw.choice(WORDS)))
        if "do" in word:
            do = mutate_tree(draw, word["do"]) if draw.random() < 0.7 else word["do"]
            word["do"] = json.dumps(do)
            if draw.random() < 0.1:
                word["do"] = mutate_bytes(draw, word["do"].encode()).decode(errors="replace")
        if word["kind"] in {"act", "beat"}:
            self._number += 1
            said = word.get("do", "beat")
            word |= {
                "id": self._number,
                "mac": self._code(f"{visit.nonce}\n{self._number}\n{said}"),
            }
        match draw.randrange(6):
            case 0:
                return json.dumps(mutate_tree(draw, word))
            case 1:
                raw = mutate_bytes(draw, json.dumps(word).encode())
                return raw if draw.random() < 0.2 else raw.decode(errors="replace")
            case _:
                return json.dumps(word)

    async def say(self, word: str | bytes) -> None:
        """Say it, and wait until what it asks for is done; raise what it is told of."""
        self.page.show('{"kind":"frame","tick":1}', 1)
        await self.page.receive(word)
        while doing := [*self.page._doing, *self.page._stopping]:
            await asyncio.gather(*doing, return_exceptions=True)
            await asyncio.sleep(0)
        self.operator._survive(self.operator._flush)
        told = [json.loads(each) for each in self.page._words]
        self.page._words.clear()
        for each in told:
            error = each.get("error") or ""
            if error.partition(":")[0].endswith(("Error", "Exception", "Interrupt")):
                raise RuntimeError(f"told a page: {error}")
            if error:
                raise UsageError(error)


@amount(300)
def test_every_word_of_a_page_is_done_or_refused(
    count: int,
    findings: Findings,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(page_module, "MOST_WRONG", 1 << 40)
    monkeypatch.setattr(page_module, "MOST_A_SECOND", 1 << 40)
    draw = random.Random(count)
    loop = asyncio.new_event_loop()
    hand = Hand(draw, new_token())

    def decode(word: str | bytes) -> None:
        loop.run_until_complete(hand.say(word))

    try:
        for place in range(count):
            if place % 500 == 499:
                hand.operator.close()
                hand = Hand(draw, new_token())
            findings.judge(decode, hand.word())
    finally:
        hand.operator.close()
        loop.close()
    findings.check(count)
    assert findings.outcomes["taken"] > count // 20


@pytest.mark.parametrize(
    "count", [pytest.param(20, marks=pytest.mark.slow), pytest.param(1000, marks=pytest.mark.long)]
)
def test_a_server_outlives_what_is_no_websocket(count: int) -> None:
    draw = random.Random(count)
    with Served(StillSource(), NotingOperator(), new_token()) as served:
        host, _, port = served.host.rpartition(":")
        hello = (
            f"GET /socket HTTP/1.1\r\nHost: {served.host}\r\nOrigin: http://{served.host}\r\n"
            "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        ).encode()
        frame = b"\x81\x91\x01\x02\x03\x04" + bytes(17)
        for _ in range(count):
            with suppress(OSError), socket.create_connection((host, int(port))) as raw:
                raw.settimeout(0.0)
                broken = draw.random() < 0.5
                raw.sendall(mutate_bytes(draw, hello) if broken else hello)
                raw.sendall(mutate_bytes(draw, frame))
        with page(served.host, served.token) as pen:
            assert pen.prove()
            assert pen.act(verb="stop")["error"] is None
