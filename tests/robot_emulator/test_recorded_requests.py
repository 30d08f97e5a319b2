"""What clients do stands in the robot's log: requests, tokens, their configuration."""

from __future__ import annotations

import json

import pytest
from support.robot_bench import Bench, active

from hoap3.protocol.link.session_limits import MAX_CONFIG_BYTES
from hoap3.protocol.runtime.event_limit import BURST
from hoap3.protocol.runtime.shm_ring import Kind


def told(bench: Bench, kind: Kind) -> list[dict[str, object]]:
    """Records of a kind, as JSON."""
    return [json.loads(payload) for payload in bench.recorder.payloads(kind)]


def test_a_request_is_recorded_with_who_verb_and_answer():
    bench = active()
    stop, status = bench.link.ask("stop", "somebody"), bench.link.ask("status", "other")
    bench.run(1)
    asked = {fact["verb"]: fact for fact in told(bench, Kind.REQUEST)}
    assert asked["stop"]["who"] == "somebody"
    assert asked["stop"]["answer"] == stop[0]
    assert asked["status"]["answer"] == status[0]
    assert asked["acquire"]["answer"]["granted"] is True


def test_what_is_long_is_recorded_by_its_size():
    bench = active()
    answers = bench.link.ask("description", "other")
    bench.run(1)
    (asked,) = [fact for fact in told(bench, Kind.REQUEST) if fact["verb"] == "description"]
    assert asked["answer"] == {"bytes": len(answers[0])}


def test_many_requests_of_one_kind_are_counted_and_left_out():
    bench = active()
    for _ in range(3 * BURST):
        bench.link.ask("status", "poller")
    bench.run(1500)
    facts = [fact for fact in told(bench, Kind.REQUEST) if fact["verb"] == "status"]
    recorded = [fact for fact in facts if "left_out" not in fact]
    assert len(recorded) == BURST
    assert sum(fact.get("left_out", 0) for fact in facts) == 2 * BURST


def test_tokens_are_recorded_as_they_come_and_go(monkeypatch):
    bench = active()
    monkeypatch.setattr(bench.link, "tokens", lambda: (("a", True), ("b", False)))
    bench.run(1)
    found = [(fact["who"], fact["present"]) for fact in told(bench, Kind.TOKEN)]
    assert found == [("a", True), ("b", False)]


@pytest.mark.parametrize("body", [b'{"controller": "qp12"}', b'{}, "who": "robot"', b"\xff{"])
def test_the_holders_configuration_is_recorded_once_as_text(body):
    bench = Bench()
    bench.link.ask("acquire", "me", body)
    bench.link.ask("acquire", "me", body)
    bench.link.ask("acquire", "other", b'{"controller": "pinv"}')
    bench.run(2)
    config = body.decode("utf-8", "replace")
    assert told(bench, Kind.CONFIG) == [{"side": "controller", "who": "me", "config": config}]


def test_configurations_that_are_long_or_many_are_left_out():
    bench = Bench()
    bench.link.ask("acquire", "me", bytes(MAX_CONFIG_BYTES + 1))
    bench.link.ask("release", "me")
    for _ in range(3 * BURST):
        bench.link.ask("acquire", "me", b"{}")
        bench.link.ask("release", "me")
    bench.run(2)
    assert len(told(bench, Kind.CONFIG)) == BURST
