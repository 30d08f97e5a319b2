"""After an attack on a robot its controller follows it again: each time, within ten seconds."""

from __future__ import annotations

import json
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
import zenoh
from support.command_bench import (
    PATIENCE_S,
    Command,
    assert_no_traceback,
    endpoint,
    followed,
    spread,
    tell,
    wait_for_mode,
)

TIMES = 20
BACK_S = 10.0
FLOOD_S = 3.0


@contextmanager
def stranger(at: str) -> Iterator[zenoh.Session]:
    """A client that bounds nothing."""
    config = {
        "mode": "client",
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "connect": {"endpoints": [at]},
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        yield session


def one_large_request(at: str) -> None:
    with stranger(at) as session:
        list(session.get("robots/hoap3/control/change", payload=b"x" * 50_000_000, timeout=2.0))


def many_requests(at: str) -> None:
    """Some thousand a second, 100 at a time."""
    with stranger(at) as session:
        end = time.monotonic() + FLOOD_S
        while time.monotonic() < end:
            waiting = [
                session.get("robots/hoap3/ask/acquire", payload=b"flood", timeout=1.0)
                for _ in range(100)
            ]
            for replies in waiting:
                list(replies)


class Relay:
    """Passes the bytes of TCP connections on; those that it holds get nothing more, and no end.

    Args:
        at: endpoint to connect to, on loopback.

    Attributes:
        at: endpoint to connect to instead.
    """

    def __init__(self, at: str) -> None:
        self._port = int(at.rpartition(":")[2])
        self._server = socket.create_server(("127.0.0.1", 0))
        self.at = f"tcp/127.0.0.1:{self._server.getsockname()[1]}"
        self._generation = 0
        threading.Thread(target=self._accept, daemon=True).start()

    def hold(self) -> None:
        """Let nothing more through on the connections of today."""
        self._generation += 1

    def close(self) -> None:
        """Take no new ones."""
        self._server.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._server.accept()
                far = socket.create_connection(("127.0.0.1", self._port))
            except OSError:
                return
            for pair in ((near, far), (far, near)):
                threading.Thread(
                    target=self._pass_on, args=(*pair, self._generation), daemon=True
                ).start()

    def _pass_on(self, source: socket.socket, sink: socket.socket, generation: int) -> None:
        try:
            while data := source.recv(65536):
                if generation == self._generation:
                    sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)
        except OSError:
            source.close()


def back(at: str, law: Command) -> float:
    """Seconds until the robot follows this controller, after `recover` where it has stopped."""
    began = time.monotonic()
    while time.monotonic() < began + PATIENCE_S:
        status = tell("status", at)
        if status["mode"] == "stopped":
            tell("recover", at)
        ours = status["holder"] is not None and f"-{law.process.pid}-" in status["holder"]
        if status["mode"] == "active" and ours and moves_on(at, status["tick"]):
            return time.monotonic() - began
        assert law.process.poll() is None, law.stderr
        os.sched_yield()
    raise AssertionError(law.stderr)


def moves_on(at: str, tick: int) -> bool:
    """Whether the robot is still active half a second of its time later."""
    while (status := tell("status", at))["tick"] < tick + 500:
        if status["mode"] != "active":
            return False
    return status["mode"] == "active"


@pytest.mark.long
@pytest.mark.parametrize("attack", [one_large_request, many_requests])
def test_the_controller_is_back_after_each_attack(attack: Callable[[str], None]) -> None:
    at = endpoint()
    with followed(at) as (robot, law):
        wait_for_mode("active", at)
        needed = []
        for _ in range(TIMES):
            attack(at)
            needed.append(back(at, law))
        assert max(needed) < BACK_S, needed
        assert_no_traceback(law)
        assert law.end(signal.SIGTERM) == 0
        wait_for_mode("idle", at)
        assert robot.end(signal.SIGTERM) in {0, 1}
        assert_no_traceback(robot)
    print(f"{attack.__name__}: back: {spread(needed, 's')}")


@pytest.mark.long
def test_the_controller_is_back_after_its_connection_has_fallen_silent() -> None:
    at = endpoint()
    relay = Relay(at)
    with followed(at, near=relay.at) as (robot, law):
        needed = []
        for _ in range(TIMES):
            wait_for_mode("active", at)
            relay.hold()
            robot_noticed(robot, len(needed) + 1)
            needed.append(back(at, law))
        assert max(needed) < BACK_S, needed
        assert law.end(signal.SIGTERM) == 0
        assert_no_traceback(law)
    relay.close()
    print(f"silent connection: back: {spread(needed, 's')}")


def robot_noticed(robot: Command, times: int) -> None:
    robot.hear(r"holder lost \(epoch \d+\)", times)
