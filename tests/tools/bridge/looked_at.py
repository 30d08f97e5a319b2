"""A robot on a real session that says what a test wants, and whoever wants to see it."""

from __future__ import annotations

import json
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Self

import zenoh
from support.command_bench import Command, endpoint

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.link.zenoh_session import key, open_session, sampled_key
from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.tools.bridge.robot_feed import Viewer, feed

WAIT_S = 20.0


class LookedAt:
    """A robot that publishes what it is told to, to those who only look.

    Args:
        description: that it gives.
        endpoint: where it listens.
        session_id: of this run of it.
    """

    def __init__(self, description: RobotDescription, endpoint: str, session_id: int = 7) -> None:
        self.description, self.session_id, self.tick = description, session_id, 0
        self._session = session = open_session(LinkSettings(listen=(endpoint,)))
        name = description.name
        self._keys = {
            State: sampled_key(name, "state/2"),
            Setpoint: sampled_key(name, "setpoint/somebody"),
            Event: key(name, "events"),
        }
        session.declare_queryable(key(name, "ask/*/*"), self._answer)
        self._token = session.liveliness().declare_token(key(name, "alive"))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    def state(self, **arrays: Any) -> State:
        """The State of the next tick."""
        state = State.allocate(**self.description.state_lengths)
        for name, values in arrays.items():
            getattr(state, name)[:] = values
        self.tick += 1
        state.tick, state.session_id = self.tick, self.session_id
        return state

    def setpoint(self) -> Setpoint:
        """An answer to the newest State."""
        setpoint = Setpoint(self.description.n)
        setpoint.tick, setpoint.session_id, setpoint.v = self.tick, self.session_id, 0.25
        return setpoint

    def say(self, message: State | Setpoint | Event) -> bytes:
        """Publish a message; its bytes."""
        payload = message.dump()
        self._session.put(self._keys[type(message)], payload)
        return payload

    def _answer(self, query: zenoh.Query) -> None:
        verb = str(query.key_expr).split("/")[3]
        status = json.dumps({"mode": "idle", "holder": None}).encode()
        answers = {"description": self.description.to_json(), "status": status}
        if verb in answers:
            query.reply(query.key_expr, answers[verb])


def assert_ends(command: Command, signum: int) -> None:
    """A signal ends the command in order."""
    assert command.end(signum) == 0
    assert "Traceback" not in command.stderr
    command.assert_no_orphan()


def assert_shows_joints(*words: object) -> None:
    """`hoap3 bridge ros2` with these words shows a ROS 2 peer joints of its robot."""
    at, seen = endpoint(), list[zenoh.Sample]()
    with Command("bridge", "ros2", *words, "--listen", at) as command:
        command.wait_for("is there")
        with open_session(LinkSettings(connect=(at,))) as peer:
            peer.declare_subscriber("0/joint_states/**", seen.append)
            until(lambda: len(seen) > 20)
        assert_ends(command, signal.SIGTERM)


@contextmanager
def fed(viewer: Viewer, find: Callable[[], tuple[str, str]]) -> Iterator[list[str]]:
    """Feed a viewer, in a thread; what was reported."""
    ended, told = threading.Event(), list[str]()
    thread = threading.Thread(target=feed, args=(find, viewer, ended.is_set, told.append))
    thread.start()
    try:
        yield told
    finally:
        ended.set()
        thread.join()


def until(true: Callable[[], Any], again: Callable[[], object] = lambda: None) -> Any:
    """Wait until something is true, doing something again and again; what it is."""
    pace = threading.Event()
    for _ in range(int(WAIT_S / 0.02)):
        found = true()
        if found:
            return found
        again()
        pace.wait(0.02)
    raise AssertionError("never came true")
