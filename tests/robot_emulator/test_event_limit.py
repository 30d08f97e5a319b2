"""Events that others can cause are limited; how many were left out is told."""

from __future__ import annotations

import pytest
from support.robot_bench import active

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.event_limit import BURST, PERIOD_NS, EventLimit

REFUSED = Event.schema.constants["REFUSED"]


def passed(limit: EventLimit, times: list[int], kind: str = "REFUSED") -> list[bool]:
    return [limit.passes(kind, now) for now in times]


def test_a_burst_passes_then_one_a_second():
    limit = EventLimit()
    assert passed(limit, [5] * BURST) == [True] * BURST
    assert passed(limit, [6, 5 + PERIOD_NS - 1]) == [False, False]
    assert passed(limit, [5 + PERIOD_NS, 5 + PERIOD_NS]) == [True, False]


def test_a_quiet_time_allows_another_burst_but_no_larger_one():
    limit = EventLimit()
    passed(limit, [0] * BURST)
    later = 100 * BURST * PERIOD_NS
    assert passed(limit, [later] * (BURST + 1)) == [True] * BURST + [False]


def test_kinds_are_limited_apart_and_others_not_at_all():
    limit = EventLimit()
    passed(limit, [0] * 2 * BURST)
    assert limit.passes("GRANTED", 0)
    assert all(passed(limit, [0] * 100, "SAFE_STOP"))


def test_what_was_left_out_is_told_once_a_second_until_all_is_told():
    limit = EventLimit()
    passed(limit, [0] * (BURST + 7))
    assert limit.left_out(PERIOD_NS - 1) == []
    assert limit.left_out(PERIOD_NS) == [("REFUSED", 7)]
    assert limit.left_out(PERIOD_NS) == []
    passed(limit, [PERIOD_NS] * 3)
    assert limit.left_out(2 * PERIOD_NS - 1) == []
    assert limit.left_out(2 * PERIOD_NS) == [("REFUSED", 2)]
    assert limit.left_out(100 * PERIOD_NS) == []


def test_a_flood_of_refusals_is_a_few_events_and_their_number():
    bench = active("alice")
    bench.run(1)
    answers = []
    second = PERIOD_NS // bench.robot.period
    for _ in range(15):
        answers += [bench.link.ask("acquire", "stranger") for _ in range(40)]
        bench.run(second // 10)
    assert all(not answer["granted"] for (answer,) in answers)
    found = [(name, detail) for name, _, detail in bench.events()]
    refused = [detail for name, detail in found if name == "REFUSED"]
    told = [detail for name, detail in found if name == "SUPPRESSED"]
    assert BURST <= len(refused) <= BURST + 3
    assert len(told) in (1, 2)
    assert {detail & 0xFF for detail in told} == {REFUSED}
    bench.run(second + 1)
    told = [detail for name, _, detail in bench.events() if name == "SUPPRESSED"]
    assert len(refused) + sum(detail >> 8 for detail in told) == len(answers)


def test_what_was_left_out_in_the_last_second_is_told_at_the_end():
    bench = active("alice")
    bench.run(1)
    for _ in range(40):
        bench.link.ask("acquire", "stranger")
    bench.robot.run(bench.clock.now(), lambda: bench.robot.tick >= 30)
    found = [(name, detail) for name, _, detail in bench.events()]
    refused = [detail for name, detail in found if name == "REFUSED"]
    told = [detail for name, detail in found if name == "SUPPRESSED"]
    assert len(refused) + sum(detail >> 8 for detail in told) == 40
    assert found[-1][0] == "ENDED"


@pytest.mark.slow
def test_a_controller_that_chatters_is_a_few_events_and_counted_in_full():
    bench = active("alice")
    bench.run(1)
    for sign in [1.0, -1.0] * 100:
        bench.speed[:] = 2.5 * sign  # more than the limit of acceleration allows in one tick
        bench.run(10)
    seconds = 200 * 10 * bench.robot.period // PERIOD_NS
    found = [(name, detail) for name, _, detail in bench.events()]
    clipped = [detail for name, detail in found if name == "CLIPPED"]
    assert BURST <= len(clipped) <= BURST + seconds
    bench.speed[:] = 0.0
    bench.run(PERIOD_NS // bench.robot.period + 20)
    told = [detail for name, _, detail in bench.events() if name == "SUPPRESSED"]
    assert {detail & 0xFF for detail in told} == {Event.schema.constants["CLIPPED"]}
    left_out = sum(detail >> 8 for detail in told)
    assert 200 - 1 <= len(clipped) + left_out <= 200 + 1
    summary = bench.robot.summary()
    assert summary["interventions"] >= len(clipped) + left_out
