"""A robot that acts ahead of its ticks does what one does that waits for them."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from support.robot_bench import Bench, active
from support.small_arm import PERIOD_NS

from hoap3.protocol.messages import Setpoint, State

LEAD = PERIOD_NS // 4
TICKS = 60

delays = st.lists(
    st.one_of(
        st.just([PERIOD_NS // 5]),
        st.lists(st.integers(0, 3 * PERIOD_NS), max_size=3),
        st.sampled_from(
            [[PERIOD_NS - LEAD], [PERIOD_NS - LEAD + 1], [PERIOD_NS], [PERIOD_NS + 1], []]
        ),
    ),
    min_size=TICKS,
    max_size=TICKS,
)
ENDING = 20  # ticks: who oversleeps the end of a run ends it a tick later where it has acted
oversleeps = st.dictionaries(
    st.integers(0, TICKS - ENDING), st.integers(1, 4 * PERIOD_NS), max_size=4
)


def motion(lead: int, script: list[list[int]], late: dict[int, int], forged: set[int]) -> Bench:
    """Answers of each tick arrive after the scripted delays; some wake-ups come late."""

    def fate(tick: int, answer: bytes) -> list[tuple[int, bytes]]:
        arrivals = [(delay, answer) for delay in script[tick % TICKS]]
        if tick % TICKS in forged:
            arrivals.append((PERIOD_NS - 1, of_the_next_tick(answer)))
        return arrivals

    bench = Bench(fate, lead=lead, misses_to_stop=8)
    bench.speed[:] = 0.1
    bench.link.ask("acquire", "test")
    bench.oversleep(late)
    bench.robot.run(0, lambda: False, TICKS - 10)
    return bench


def of_the_next_tick(answer: bytes) -> bytes:
    setpoint = Setpoint(3)
    setpoint.load(answer)
    setpoint.tick += 1
    return setpoint.dump()


@pytest.mark.slow
@given(delays, oversleeps, st.sets(st.integers(0, TICKS - 1), max_size=5))
@example([[PERIOD_NS // 5]] * TICKS, {4: PERIOD_NS}, {3})
def test_states_and_counts_are_the_same(script, late, forged):
    waiting = motion(0, script, dict(late), forged)
    ahead = motion(LEAD, script, dict(late), forged)
    assert [state.dump() for state in ahead.states()] == [s.dump() for s in waiting.states()]
    assert ahead.robot.summary() == waiting.robot.summary()
    told, sooner = ([event[::2] for event in each.events()] for each in (waiting, ahead))
    assert Counter(told) == Counter(sooner)  # of a message it tells before it oversleeps a tick


def asked_for(lead: int, grace: int, requests: dict[int, str]) -> Bench:
    """Somebody asks for something as soon as a State is out."""
    bench = Bench(lead=lead, grace=grace)
    bench.speed[:] = 0.1
    published = bench.link.publish

    def publish(payload: bytes) -> None:
        published(payload)
        if bench.robot.tick in requests:
            bench.link.ask(requests[bench.robot.tick], "test")

    bench.link.publish = publish
    stop = iter([False] * TICKS)
    bench.robot.run(0, lambda: next(stop, True))
    return bench


@pytest.mark.slow
@given(
    st.sampled_from([0, 3]),
    st.dictionaries(
        st.integers(0, TICKS), st.sampled_from(["acquire", "release", "stop", "recover"])
    ),
)
def test_requests_are_served_at_the_same_ticks(grace, requests):
    waiting = asked_for(0, grace, requests)
    ahead = asked_for(LEAD, grace, requests)
    assert [state.dump() for state in ahead.states()] == [s.dump() for s in waiting.states()]
    assert [event[::2] for event in ahead.events()] == [event[::2] for event in waiting.events()]


def test_the_body_has_moved_before_the_tick_begins():
    bench, moved = Bench(lead=LEAD, grace=3), []
    bench.link.ask("acquire", "test")
    step = bench.robot.plant.step
    bench.robot.plant.step = lambda *how: (moved.append(bench.clock.now()), step(*how))
    bench.robot.run(0, lambda: False, 20)
    assert len(moved) >= 20
    assert {at % PERIOD_NS for at in moved} == {PERIOD_NS - LEAD}  # the first one, too


def test_a_request_that_comes_after_it_has_acted_waits_for_the_next_tick():
    bench = active(lead=LEAD)
    answers: list[object] = []
    waited = bench.clock.sleep_until

    def sleep_until(deadline: int) -> None:
        waited(deadline)
        if deadline == 10 * PERIOD_NS:
            answers.append(bench.link.ask("stop", "test"))

    bench.clock.sleep_until = sleep_until
    bench.robot.run(0, lambda: False, 30)
    modes = {state.tick: state.mode for state in bench.states()}
    assert modes[10] == State.ACTIVE
    assert modes[11] != State.ACTIVE
    assert answers[0][0]["mode"] in {"stopping", "stopped"}
