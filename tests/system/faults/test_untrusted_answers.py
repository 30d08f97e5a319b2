"""A robot that answers nonsense, or falls silent, ends no client: it is asked again."""

from __future__ import annotations

import json
import os
import random
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from support.command_bench import PATIENCE_S, endpoint, inside
from support.fake_robot import GOOD, STATUS, FakeRobot, good, nonsense

from hoap3.protocol.answers import (
    MAX_CONTROL_BYTES,
    ControlAnswer,
    GrantAnswer,
    Recovery,
    Status,
    parse_answer,
    parse_description,
)
from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import AuthorityError, WireError
from hoap3.protocol.link.local_control import LocalRobot
from hoap3.protocol.messages import State
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.remote_controller import service
from hoap3.remote_controller.config import ControllerConfig, read_config
from hoap3.robot_emulator.robots import load

ROBOT = load("hoap3")
DESCRIPTION = ROBOT.to_json()
MODELS = {"recover": Recovery, "acquire": GrantAnswer}
MODELS |= dict.fromkeys(("status", "stop"), Status)
MODELS |= dict.fromkeys(("show", "change"), ControlAnswer)
COMMANDS = {
    "status": ("status",),
    "stop": ("stop",),
    "recover": ("recover",),
    "show": ("change",),
    "change": ("change", "{}"),
    "description": ("record", "--duration", "0.01"),
}


def unusable(verb: str, draw: random.Random) -> bytes:
    """Nonsense that is surely none of the answers that are accepted."""
    while True:
        raw = nonsense(verb, DESCRIPTION, draw)
        try:
            if verb == "description":
                parse_description(raw, ROBOT.name)
            else:
                parse_answer(MODELS[verb], raw, "robot", MAX_CONTROL_BYTES)
        except WireError:
            return raw


@pytest.fixture
def robots() -> Iterator[Callable[..., tuple[FakeRobot, str]]]:
    opened = []

    def make(script: Callable[[str, str], bytes | None]) -> tuple[FakeRobot, str]:
        at = endpoint()
        opened.append(FakeRobot(at, script))
        return opened[-1], at

    yield make
    for robot in opened:
        robot.close()


class Controller:
    """The service in a thread of this process."""

    def __init__(self, at: str, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(service, "prepare_process", lambda _: [])  # it is the tests' process
        content = {**read_config("pinv")[0], "link": {"connect": [at]}}
        self.said: list[str] = []
        self.log = MemoryRecorder()
        self._stop = threading.Event()
        self._wake: Callable[[], None] = lambda: None
        self.service = service.Service(
            parse(ControllerConfig, content, "config"),
            self.log,
            self.said.append,
            self._stop.is_set,
            on_stop=self._take,
        )
        self.failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Controller:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        self._stop.set()
        self._wake()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        assert self.failure is None, self.failure

    @property
    def link(self) -> Any:
        return self.service._link

    def _take(self, wake: Callable[[], None]) -> None:
        self._wake = wake

    def _run(self) -> None:
        try:
            self.service.run()
        except Exception as error:  # noqa: BLE001 - whatever it is, the test shall see it
            self.failure = error

    def wait_for(self, condition: Callable[[], Any]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert self.failure is None, self.failure
            assert time.monotonic() < end, self.said
            os.sched_yield()

    def wait_for_setpoint(self, robot: FakeRobot) -> None:
        """Send States that ask for an answer until there is one."""
        states = asking()
        robot.setpoint.clear()

        def answered() -> bool:
            robot.publish(next(states))
            return robot.setpoint.wait(0.001)

        self.wait_for(answered)


def asking() -> Iterator[bytes]:
    """States of a robot that is active under epoch 1."""
    state = State(ROBOT.n, 6 * len(ROBOT.wrench_sensors))
    state.mode, state.epoch, state.session_id = State.ACTIVE, 1, STATUS["session_id"]
    state.epoch_from_tick = 23
    state.q[:] = state.reference[:] = ROBOT.initial_position
    for tick in range(int(time.monotonic() * 1e3), 10**12):
        state.tick = tick
        yield bytes(state.dump())


@pytest.mark.parametrize("count", [100, pytest.param(1000, marks=pytest.mark.long)])
def test_malformed_answers_end_no_controller(count, robots, monkeypatch):
    monkeypatch.setattr(service, "RETRY_S", 0.001)
    draw, sent = random.Random(count), Counter[str]()
    shares = {"description": count // 3, "status": count // 3, "acquire": count - 2 * (count // 3)}

    def script(verb: str, _: str) -> bytes:
        if sent[verb] < shares.get(verb, 0):
            sent[verb] += 1
            return unusable(verb, draw)
        return good(verb, DESCRIPTION)

    robot, at = robots(script)
    with Controller(at, monkeypatch) as controller:
        controller.wait_for_setpoint(robot)
        assert controller.service.sessions == 1
        assert controller.service.unusable == sent.total() == count
    assert len([line for line in controller.said if "asking again" in line]) == 1
    assert controller.said[-1] == f"{count} answers of robot 'hoap3' were unusable"


@pytest.mark.parametrize("verb", COMMANDS)
def test_a_command_has_one_error_for_a_malformed_answer(verb, robots, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    draw, answers = random.Random(verb), [b""]
    _, at = robots(lambda asked, _: answers[0] if asked == verb else good(asked, DESCRIPTION))
    for _ in range(4):
        answers[0] = unusable(verb, draw)
        done = inside(*COMMANDS[verb], "--connect", at)
        assert done.code == 1, done
        (error,) = done.stderr.splitlines()
        assert error.startswith("error: ")
        assert "'hoap3'" in error
        assert list(tmp_path.iterdir()) == []
    answers[0] = good(verb, DESCRIPTION)
    assert inside(*COMMANDS[verb], "--connect", at).code == 0


@pytest.mark.long
def test_hundreds_of_malformed_answers_end_no_command(robots):
    draw = random.Random(16)
    wrong: list[bytes] = [b""]
    _, at = robots(lambda *_: wrong[0])
    for number in range(1000):
        verb = list(COMMANDS)[number % 5]  # all but the recording
        wrong[0] = unusable(verb, draw)
        done = inside(*COMMANDS[verb], "--connect", at)
        assert done.code == 1, (verb, wrong[0][:200], done)
        assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("verb", ["status", "stop", "recover", "release"])
def test_an_answer_over_the_local_socket_is_checked_too(verb, monkeypatch):
    local = LocalRobot("hoap3", 1, Path("nowhere"))
    monkeypatch.setattr("hoap3.tools.services.find_robot._find_all", lambda _: [local])
    monkeypatch.setattr(LocalRobot, "ask", lambda *_: {"mode": 3, "released": "yes"})
    done = inside(verb)
    assert (done.code, len(done.stderr.splitlines())) == (1, 1)
    assert f"robot 'hoap3' answers '{verb}' with nonsense" in done.stderr


def test_names_from_the_network_are_escaped(robots):
    esc = "\x1b]0;mine\x07\n"
    answers = {
        "status": {**STATUS, "holder": esc},
        "show": {"error": None, "now": {"priorities": {
            "names": [esc], "alpha": [[1.0]], "moving": False, "out": [esc],
        }}},
        "change": {"error": f"refused {esc}", "now": None},
    }  # fmt: skip
    _, at = robots(lambda verb, _: json.dumps(answers[verb]).encode())
    for verb in answers:
        done = inside(*COMMANDS[verb], "--connect", at)
        told = done.stdout + done.stderr
        assert "\\x1b]0;mine\\x07" in told or "\\u001b]0;mine\\u0007" in told  # as JSON
        assert all(char.isprintable() or char == "\n" for char in told)
    assert inside("status", "--connect", at, "--json").json()["holder"] == esc


@pytest.mark.parametrize("name", ["127.0.0.1:7447", "tcp://127.0.0.1:7447", "", "\x1b[2J"])
@pytest.mark.parametrize("words", [*COMMANDS.values(), ("list", "--live")])
def test_what_is_no_endpoint_is_one_error_with_the_remedy(words, name):
    done = inside(*words, "--connect", name)
    assert done.code == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert line.endswith("tcp/127.0.0.1:7447")


def test_a_silent_robot_is_followed_again_in_a_new_session(robots, monkeypatch):
    """It stays connected, but neither publishes nor answers until a new session has come."""
    monkeypatch.setattr(service, "SILENCE_S", 0.1)
    monkeypatch.setattr("hoap3.protocol.link.zenoh_clients.QUERY_TIMEOUT_S", 0.2)
    silent_to: list[str] = []

    def script(verb: str, who: str) -> bytes | None:
        return None if who in silent_to else good(verb, DESCRIPTION)

    robot, at = robots(script)
    with Controller(at, monkeypatch) as controller:
        controller.wait_for_setpoint(robot)
        first = controller.link
        silent_to.append(first.who)
        controller.wait_for(lambda: controller.service.sessions > 1)
        controller.wait_for_setpoint(robot)
        assert controller.link.who.startswith(f"{first.who}-")
        assert first._session.is_closed()
        assert not first._answers._thread.is_alive()
    assert "robot 'hoap3' is silent" in controller.said


def test_a_robot_that_answers_no_request_is_asked_in_a_new_session(robots, monkeypatch):
    monkeypatch.setattr(service, "SILENCE_S", 0.1)
    robot, at = robots(lambda verb, _: good(verb, DESCRIPTION) if len(robot.clients) > 1 else None)
    with Controller(at, monkeypatch) as controller:
        controller.wait_for_setpoint(robot)
        assert controller.service.sessions > 1


def test_authority_that_our_last_session_still_has_is_waited_for(robots, monkeypatch):
    monkeypatch.setattr(service, "RETRY_S", 0.001)
    refusals = iter(range(5))

    def script(verb: str, who: str) -> bytes:
        if verb == "acquire" and next(refusals, None) is not None:
            return json.dumps({**STATUS, "holder": who, "granted": False}).encode()
        return good(verb, DESCRIPTION)

    robot, at = robots(script)
    with Controller(at, monkeypatch) as controller:
        controller.wait_for_setpoint(robot)
    assert robot.asked["acquire"] == 6


def test_a_controller_of_a_like_name_is_not_taken_for_a_session_of_ours(robots, monkeypatch):
    def script(verb: str, who: str) -> bytes:
        if verb == "acquire":
            return json.dumps({**STATUS, "holder": f"{who}-2", "granted": False}).encode()
        return good(verb, DESCRIPTION)

    robot, at = robots(script)
    refused = Controller(at, monkeypatch)
    with pytest.raises(AuthorityError):
        refused.service.run()
    assert robot.asked["acquire"] == 1


def test_an_end_while_the_robot_is_silent_comes_at_once(robots, monkeypatch):
    monkeypatch.setattr(service, "SILENCE_S", PATIENCE_S)
    robot, at = robots(lambda verb, _: good(verb, DESCRIPTION))
    with Controller(at, monkeypatch) as controller:
        controller.wait_for_setpoint(robot)
        robot.setpoint.clear()
        before = threading.active_count()
        controller.stop()
        assert threading.active_count() < before
    assert robot.asked["release"] == 1


def test_virtual_time_that_stands_still_is_no_silence(robots, monkeypatch):
    monkeypatch.setattr(service, "SILENCE_S", 0.02)
    lockstep = json.dumps({**STATUS, "lockstep": True}).encode()
    robot, at = robots(lambda verb, _: lockstep if verb == "status" else good(verb, DESCRIPTION))
    with Controller(at, monkeypatch) as controller:
        controller.wait_for(lambda: robot.asked["status"] > 5)
        assert controller.service.sessions == 1
        controller.wait_for_setpoint(robot)


def test_all_that_an_honest_robot_says_is_known_to_the_fake_one():
    assert GOOD.keys() >= MODELS.keys()


def test_an_end_while_new_sessions_are_tried_comes_at_once(robots, monkeypatch):
    monkeypatch.setattr(service, "SILENCE_S", 0.01)
    monkeypatch.setattr(service, "RETRY_S", 0.01)
    _, at = robots(lambda *_: None)
    before = threading.active_count()
    with Controller(at, monkeypatch) as controller:
        controller.wait_for(lambda: controller.service.sessions > 3)
        controller.stop()
        controller.wait_for(lambda: threading.active_count() <= before)  # Zenoh ends its own later
    assert controller.link._session.is_closed()
    told = [line for line in controller.said if "trying a new session" in line]
    assert len(told) == 1
