"""Attacks on a running robot: `floods.py KIND ENDPOINT ROBOT SECONDS`.

Each is one process without rights, as a stranger on the robot's network is. It ends by itself, and
prints one JSON object: what it sent, and how often the robot cut it off.
"""

from __future__ import annotations

import contextlib
import json
import resource
import socket
import sys
import time
from collections.abc import Callable

import zenoh

BIG = 50_000_000  # bytes
MESSAGES_A_SECOND = 20_000
QUERIES_A_SECOND = 3_000
CONNECTIONS = 1_000
PUTS = ("state", "setpoint", "events", "alive", "clients/x", "other")
ASKED = ("status", "acquire", "release", "recover", "description", "nonsense")
QUERIES = (
    *(f"ask/{verb}/stranger" for verb in ASKED),
    *("control/change/stranger", "control/show/stranger"),
)
KINDS = ("idle", "messages", "queries", *(f"big:{key}" for key in (*PUTS, *QUERIES)))


class Attacker:
    """A client of the robot that comes back when it is cut off.

    Attributes:
        cut: how often it was.
    """

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._session: zenoh.Session | None = None
        self.cut = -1

    def session(self) -> zenoh.Session | None:
        """A session that is connected; None where the robot takes none now."""
        if self._session is not None and self._session.info.routers_zid() == []:
            peers = self._session.info.peers_zid()
            if not peers:
                self._session.close()
                self._session = None
        if self._session is None:
            there = {"endpoints": [self._endpoint], "timeout_ms": 500}
            alone = {"multicast": {"enabled": False}}
            config = {"mode": "client", "connect": there, "scouting": alone}
            with contextlib.suppress(zenoh.ZError):
                self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
                self.cut += 1
        return self._session


def send_big(endpoint: str, robot: str, leaf: str, end: float) -> dict[str, int]:
    """Messages of 50 MB on one key, one after the other."""
    attacker, payload, sent = Attacker(endpoint), bytes(BIG), 0
    expression = f"robots/{robot}/{leaf}"
    while time.monotonic() < end:
        session = attacker.session()
        if session is None:
            time.sleep(0.05)
            continue
        with contextlib.suppress(zenoh.ZError):
            if leaf in QUERIES:
                list(session.get(expression, payload=payload, timeout=1.0))
            else:
                session.put(expression, payload, congestion_control=zenoh.CongestionControl.BLOCK)
        sent += 1
    return {"sent": sent, "cut": attacker.cut}


def send_many(
    endpoint: str, end: float, rate: int, send: Callable[[zenoh.Session, int], None]
) -> dict[str, int]:
    """Call `send` so many times a second, or as often as can be."""
    attacker, sent = Attacker(endpoint), 0
    begin = time.monotonic()
    while (now := time.monotonic()) < end:
        session = attacker.session()
        due = int((now - begin) * rate) - sent
        if session is None or due < rate // 1000:
            time.sleep(0.001)
            continue
        for _ in range(min(due, rate // 20)):
            with contextlib.suppress(zenoh.ZError):
                send(session, sent)
            sent += 1
    return {"sent": sent, "cut": attacker.cut}


def send_messages(endpoint: str, robot: str, end: float) -> dict[str, int]:
    """Setpoints that are none."""
    keys = [f"robots/{robot}/{leaf}" for leaf in ("setpoint", "setpoint", "events", "clients/x")]

    def send(session: zenoh.Session, number: int) -> None:
        session.put(keys[number % len(keys)], b"\x00\x01\x00\x00" + bytes(500))

    return send_many(endpoint, end, MESSAGES_A_SECOND, send)


def send_queries(endpoint: str, robot: str, end: float) -> dict[str, int]:
    """Queries of all kinds whose answers are thrown away."""
    keys = [f"robots/{robot}/{leaf}" for leaf in QUERIES if "recover" not in leaf]

    def send(session: zenoh.Session, number: int) -> None:
        ring = zenoh.handlers.RingChannel(1)  # a callback would have a thread for each query
        session.get(keys[number % len(keys)], ring, timeout=1.0)

    return send_many(endpoint, end, QUERIES_A_SECOND, send)


def sit_idle(endpoint: str, end: float) -> dict[str, int]:
    """A thousand connections that never say a word, each made again when it is closed."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
    open_ones: list[socket.socket] = []
    made = closed = 0
    while time.monotonic() < end:
        kept = []
        for one in open_ones:
            try:
                ended = one.recv(1) == b""
            except BlockingIOError:
                ended = False
            except OSError:
                ended = True
            if ended:
                one.close()
                closed += 1
            else:
                kept.append(one)
        open_ones = kept
        for _ in range(min(100, CONNECTIONS - len(open_ones))):
            one = socket.socket()
            one.settimeout(0.2)
            try:
                one.connect((host, int(port)))
            except OSError:
                one.close()
                break
            one.setblocking(False)
            open_ones.append(one)
            made += 1
        time.sleep(0.02)
    for one in open_ones:
        one.close()
    return {"sent": made, "cut": closed}


def main() -> None:
    """See the module."""
    kind, endpoint, robot, seconds = sys.argv[1:]
    end = time.monotonic() + float(seconds)
    if kind == "idle":
        outcome = sit_idle(endpoint, end)
    elif kind == "messages":
        outcome = send_messages(endpoint, robot, end)
    elif kind == "queries":
        outcome = send_queries(endpoint, robot, end)
    else:
        outcome = send_big(endpoint, robot, kind.removeprefix("big:"), end)
    print(json.dumps(outcome), flush=True)


if __name__ == "__main__":
    main()
