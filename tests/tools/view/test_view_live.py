"""A running robot as a source, of a network that the test plays: who it is, and what it says."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from types import SimpleNamespace
from typing import Any

import pytest
from support.small_arm import arm

from hoap3.protocol.errors import LinkError
from hoap3.protocol.link import zenoh_session
from hoap3.protocol.messages import Event, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.recorder import MemoryRecorder, NoRecorder
from hoap3.tools.analysis.verdicts import judge_run
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.run_statistics import RunStatistics
from hoap3.tools.services.simulate import Lockstep
from hoap3.tools.view.sources import live
from hoap3.tools.view.sources.live import Live

ROBOT = arm()
PATIENCE_S = 60.0
STATUS = {"mode": "active", "tick": 5, "lockstep": False, "stop_reason": None}


class Network:
    """A robot and its controller that answer, or do not."""

    def __init__(self) -> None:
        self.description: RobotDescription = ROBOT
        self.session_id, self.extra, self.gamma = 7, "first", 0.5
        self.counts: object = None
        self.outcome: object = None
        self.silent: dict[str, int] = {}  # verbs, and how often they are not answered
        self.asked: list[str] = []
        self.opened = 0
        self.heard: dict[str, Callable[[Any], None]] = {}

    def ask(
        self, _: Any, robot: str, verb: str, who: str, body: bytes = b"", whom: str = "ask"
    ) -> bytes | None:
        del robot, who, body, whom
        self.asked.append(verb)
        if self.silent.get(verb, 0):
            self.silent[verb] -= 1
            return None
        if verb == "description":
            return self.description.to_json()
        if verb in {"status", "stop"}:
            who = {"holder": "law", "session_id": self.session_id, "counts": self.counts}
            return json.dumps({**STATUS, **who}).encode()
        if verb == "config":
            return b"{}"
        now = {"about": {"extra": [self.extra]}, "show": {"gamma": self.gamma}}
        now["tasks"] = {"tasks": [], "operator": None, "outcome": self.outcome}
        return json.dumps({"error": None, "now": now.get(verb, {})}).encode()

    def session(self, _: Any, robot: str) -> Any:
        """As zenoh has it."""
        self.opened += 1

        def declare(key: str, heard: Any) -> None:
            self.heard[str(key)] = heard

        return SimpleNamespace(close=lambda: None, declare_subscriber=declare)

    def send(self, state: State) -> None:
        """A State for those who look on."""
        payload = state.dump()
        (heard,) = (each for key, each in self.heard.items() if "sampled/state" in key)
        heard(SimpleNamespace(payload=SimpleNamespace(to_bytes=lambda: payload)))


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> Network:
    made = Network()
    monkeypatch.setattr(zenoh_session, "ask", made.ask)
    monkeypatch.setattr(zenoh_session, "check_unique", lambda *_: None)
    monkeypatch.setattr(zenoh_session, "open_session", made.session)
    monkeypatch.setattr(live, "ASK_S", 1e-3)
    return made


@pytest.fixture
def source(network: Network) -> Iterator[Live]:
    with closing(Live(ROBOT.name, "tcp/127.0.0.1:7447")) as made:
        yield made


def until(true: Callable[[], object]) -> None:
    """Wait for its thread."""
    deadline = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < deadline
        time.sleep(1e-3)


def judged(network: Network, source: Live) -> dict[str, Any]:
    """The verdicts of a State that comes after the robot was asked twice."""
    source.watched = True
    asked = network.asked.count("status")
    until(lambda: network.asked.count("status") > asked + 2)
    state = State.allocate(**ROBOT.state_lengths)
    state.session_id = 7
    network.send(state)
    frame = source.frame()
    assert frame is not None
    return frame["verdicts"]


def extra_label(source: Live) -> str:
    return {plot["key"]: plot["label"] for plot in source.hello()["plots"]}["extra.0"]


def labels(source: Live) -> list[str]:
    return [event["label"] for event in source.events()]


def test_a_robot_that_is_another_one_is_met_again_until_it_says_who_it_is(network, source):
    source.watched = True
    until(lambda: network.asked.count("status") > 2)
    version, before = source.version, source.frames
    network.silent["description"] = 3
    network.extra, network.session_id = "second", 8
    until(lambda: source.version > version)
    assert source.frames is not before
    assert network.silent["description"] == 0
    (label,) = labels(source)
    assert "no robot" in label
    asked = network.asked.count("description")
    until(lambda: network.asked.count("status") > 20)
    assert network.asked.count("description") == asked
    assert extra_label(source) == "second"


def test_who_sees_a_new_version_sees_what_it_is_of(network, source, monkeypatch):
    seen: list[tuple[int, object]] = []

    class Watched(live.Frames):
        """Notes what the source says while it is being made."""

        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            seen.append((source.version, source.frames))

    version, before = source.version, source.frames
    monkeypatch.setattr(live, "Frames", Watched)
    source.watched = True
    until(lambda: network.asked.count("status") > 2)
    network.session_id = 8
    until(lambda: source.version > version)
    assert seen == [(version, before)]


def test_a_robot_that_does_not_say_where_it_is_is_not_shown_and_told_once(network, source):
    state = State.allocate(**ROBOT.state_lengths)
    for tick, wrong in enumerate((0.0, math.nan, math.inf, 0.1), 1):
        state.session_id, state.tick, state.q[1] = 7, tick, wrong
        network.send(state)
        frame = source.frame()
        assert (frame is not None) == math.isfinite(wrong)
        assert source.frame() is None
    (label,) = labels(source)
    assert "number" in label


def test_the_page_shows_the_verdicts_of_the_terminal(network, source):
    recorded = MemoryRecorder()
    sides = load_emulator_config("hoap3", seed=0)[0], load_controller_config("pinv")[0]
    lockstep = Lockstep(*sides, recorded, NoRecorder())
    lockstep.run(1.0)  # pinv knows no limits: the robot holds a joint back
    statistics = RunStatistics(1_000_000, timing=False)
    for record in recorded.records:
        statistics.add(record)
    outcome = lockstep.controller_loop.summary
    terminal = judge_run(statistics.figures(), statistics.counts, outcome, expected=True)
    network.counts = json.loads(json.dumps(lockstep.robot.summary()))
    network.outcome = lockstep.controller_loop.summary
    verdicts = judged(network, source)
    assert {key: each["verdict"] for key, each in verdicts.items()} == terminal["verdicts"]
    assert verdicts["limits_and_balance"]["verdict"] == "fail"
    assert all(each["words"] == terminal[key]["text"] for key, each in verdicts.items())


@pytest.mark.parametrize("wrong", [None, "many", {"asked": "x"}, {"asked": 5, "in_time": None}])
def test_a_robot_that_reports_nonsense_has_no_verdict(wrong, network, source):
    network.counts, network.outcome = wrong, {"tasks": "none"}
    verdicts = judged(network, source)
    assert {each["verdict"] for each in verdicts.values()} == {"not judged"}


def test_a_stop_goes_through_the_session_that_is_open(network, source):
    assert source.stop()["mode"] == "active"
    assert network.asked[-1] == "stop"
    assert network.opened == 1
    network.silent["stop"] = 1
    with pytest.raises(LinkError):
        source.stop()


def test_who_came_between_the_start_and_the_first_look_is_met(network, source):
    network.extra, network.session_id = "second", 8
    source.watched = True
    until(lambda: source.version > 1)
    assert extra_label(source) == "second"


@pytest.mark.parametrize("ours", [False, True])
def test_numbers_are_asked_for_again_after_a_change_and_now_and_then(ours, network, monkeypatch):
    monkeypatch.setattr(live, "SHOW_S", 3600.0 if ours else 0.01)
    with closing(Live(ROBOT.name, "tcp/127.0.0.1:7447")) as source:
        source.watched = True
        assert [each["value"] for each in source.changeable()] == [0.5]
        until(lambda: network.asked.count("status") > 3)
        network.gamma = 0.9
        if ours:
            source.changed(0.01)
        until(lambda: [each["value"] for each in source.changeable()] == [0.9])
        assert source.hello()["changeable"][0]["value"] == 0.9


def test_nonsense_of_a_controller_is_told_and_asked_again(network, source, monkeypatch):
    tries: list[None] = []

    def meet() -> Any:
        tries.append(None)
        raise TypeError("nobody thought of it")

    monkeypatch.setattr(source, "_meet", meet)
    source.watched, network.session_id = True, 8
    until(lambda: len(tries) > 2)
    (label,) = labels(source)
    assert "nobody thought of it" in label


def test_skipped_periods_are_told_when_they_were(network, source, monkeypatch):
    monkeypatch.setattr(live, "SKIPS_S", 3600.0)
    source._told_s = time.monotonic()
    event = Event()
    event.kind, event.tick, event.detail = Event.schema.constants["SKIPPED"], 4000, 3
    source._heard.append(event.dump())
    assert source.events() == []
    source._told_s = -math.inf
    (told,) = source.events()
    assert told["at_s"] == 4000 * ROBOT.period_s
    assert "3" in told["label"]
