"""A robot on a real session that answers whatever a test wants, also nonsense."""

from __future__ import annotations

import json
import random
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any

import zenoh

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_session import key, open_session, state_key

Script = Callable[[str, str], bytes | None]
"""Verb of a request and its client in, the answer out; None for no answer."""

STATUS = {"mode": "idle", "holder": None, "session_id": 7, "tick": 3, "lockstep": False}
GOOD: dict[str, Any] = {
    "status": STATUS,
    "stop": {**STATUS, "mode": "stopping"},
    "recover": {**STATUS, "recovered": True},
    "acquire": {**STATUS, "granted": True, "epoch": 1, "from_tick": 23},
    "release": {"released": True},
    "show": {
        "error": None,
        "now": {"priorities": {"names": ["a"], "alpha": [[1.0]], "moving": False, "out": []}},
    },
    "change": {"error": None, "now": {"speed": 0.5}},
}


class FakeRobot:
    """Answers requests to a robot and to its controller by a script.

    Args:
        endpoint: where it listens.
        script: see above.
        name: of the robot.

    Attributes:
        asked: how often, by verb.
        setpoint: set when a Setpoint has arrived.
        clients: identities whose tokens have come, in order.
    """

    def __init__(self, endpoint: str, script: Script, name: str = "hoap3") -> None:
        self.asked: Counter[str] = Counter()
        self.setpoint = threading.Event()
        self.clients: list[str] = []
        self._script = script
        self._session = session = open_session(LinkSettings(listen=(endpoint,)))
        self._states = session.declare_publisher(
            state_key(name), express=True, priority=zenoh.Priority.REAL_TIME
        )
        session.declare_subscriber(key(name, "setpoint/*"), lambda _: self.setpoint.set())
        session.liveliness().declare_subscriber(key(name, "clients/*"), self._came, history=True)
        for whom in ("ask", "control"):
            session.declare_queryable(key(name, f"{whom}/*/*"), self._answer)
        self._token = session.liveliness().declare_token(key(name, "alive"))

    def publish(self, state: bytes) -> None:
        """Send a State."""
        self._states.put(state)

    def close(self) -> None:
        """Leave the network."""
        self._session.close()

    def _came(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self.clients.append(str(sample.key_expr).rsplit("/", 1)[-1])

    def _answer(self, query: zenoh.Query) -> None:
        verb, who = str(query.key_expr).split("/")[-2:]
        self.asked[verb] += 1
        answer = self._script(verb, who)
        with query:
            if answer is not None:
                query.reply(query.key_expr, answer)


def good(verb: str, description: bytes) -> bytes:
    """What an honest robot answers; of its configuration nothing."""
    if verb == "config":
        return b"{}"
    return description if verb == "description" else json.dumps(GOOD[verb]).encode()


JUNK = (
    b"", b" ", b"null", b"true", b"0", b'""', b"[]", b"{}", b"{", b'{"mode"', b"\xff\xfe", b"\x00",
    b'{"error": "no"}', b'{"error": 3}', b'{"granted": true}', b'{"\\ud800": 1}', b'"\\ud800"',
    b"NaN", b"-Infinity", b"1e999", b"9" * 5000, b"[" * 200_000, b'{"a":' * 200_000,
    b"[" * 100 + b"]" * 100, b"x" * 2_000_000, b'{"mode": "' + b"i" * 4000 + b'"}',
    b'[{"mode": "idle"}]', b"\xef\xbb\xbf{}",
)  # fmt: skip
_VALUES = (
    None, True, False, -1, 0, 0.5, 2**64, 10**40, "", "idle", "x" * 5000, "\x1b[2J", [], {},
    [[[]]], {"a": {}}, ["a"] * 300, float("nan"), float("inf"), "1", "true", -0.0,
)  # fmt: skip


def nonsense(verb: str, description: bytes, draw: random.Random) -> bytes:
    """Something that is not an answer: junk, or a good one with a piece cut, lost or replaced."""
    whole = good(verb, description)
    match draw.randrange(4):
        case 0:
            return draw.choice(JUNK)
        case 1:
            return whole[: draw.randrange(len(whole) - 1)]
        case 2:
            place = draw.randrange(len(whole))
            return whole[:place] + bytes([draw.randrange(256)]) + whole[place + 1 :]
        case _:
            content = json.loads(whole)
            inner = content
            while True:
                where = draw.choice(sorted(inner) if isinstance(inner, dict) else range(len(inner)))
                if isinstance(inner[where], dict | list) and inner[where] and draw.random() < 0.7:
                    inner = inner[where]
                    continue
                if isinstance(inner, dict) and draw.random() < 0.3:
                    del inner[where]
                else:
                    inner[where] = draw.choice(_VALUES)
                return json.dumps(content).encode()
