"""The words of the loop, as docs/start/concepts.md defines them, on virtual time."""

from __future__ import annotations

import numpy as np
import pytest
from support.robot_bench import active
from support.small_arm import PERIOD_NS

from hoap3.protocol.messages import State

US = 1000


def test_an_answer_after_the_wake_up_is_lost_until_it_comes_and_then_late():
    bench = active(
        fate=lambda tick, answer: [(PERIOD_NS + 500 * US, answer)] if tick == 5 else [(1, answer)]
    )
    state = bench.run(7)
    assert (state.late, state.lost) == (0, 1)
    state = bench.run(1)
    assert (state.late, state.lost) == (1, 0)
    assert state.out_of_order == 1  # tick 6 was answered at once, before the one for tick 5 came


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"tick": 10_000}, "future"),
        ({"session_id": 8}, "session"),
        ({"epoch": 2}, "epoch"),
        ({"command": 2}, "command"),
        ({"wire_version": 3}, "wire_version"),
    ],
)
def test_what_does_not_belong_here_is_rejected_by_kind(changes, reason):
    bench = active()
    bench.changes = changes
    state = bench.run(5)
    assert bench.robot.validator.rejections[reason] == 4
    assert state.rejected == 4
    assert state.lost == 4
    assert [name for name, _, _ in bench.events()].count("REJECTED") == 1


@pytest.mark.parametrize(("misses", "stops"), [(19, False), (20, True), (21, True)])
def test_twenty_misses_in_a_row_are_a_safe_stop(misses, stops):
    lost = range(50, 50 + misses)
    bench = active(fate=lambda tick, answer: [] if tick in lost else [(1, answer)])
    bench.speed[:] = (1.0, -2.0, 0.5)
    bench.run(200)
    assert (bench.robot.mode == State.STOPPED) == stops
    assert bench.robot.safe_stops == stops
    if not stops:
        assert bench.robot.validator.deadlines.longest_run == misses
        assert bench.robot.mode == State.ACTIVE
    else:
        ((_, tick, reason),) = [event for event in bench.events() if event[0] == "SAFE_STOP"]
        assert (tick, reason) == (70, 1)  # the twentieth of ticks 50 to 69 is judged at tick 70


def test_a_wake_up_that_is_periods_late_skips_ticks_and_keeps_the_phase():
    bench = active()
    bench.speed[:] = 1.0
    bench.run(10)
    before = bench.states()[-1].reference.copy()
    bench.clock.late = 3 * PERIOD_NS + 200 * US
    state = bench.run(1)
    assert state.skipped == 3
    assert state.tick == 13
    assert state.stamp_intended == 13 * PERIOD_NS
    np.testing.assert_allclose(state.reference, before + 1e-3)  # one period, not four
    assert (state.late, state.lost) == (0, 0)  # tick 9 was answered in time
    state = bench.run(1)
    assert (state.tick, state.skipped) == (14, 3)
    assert ("SKIPPED", 13, 3) in bench.events()


def test_skipped_ticks_neither_add_to_a_run_of_misses_nor_end_it():
    bench = active(fate=lambda tick, answer: [] if tick >= 10 else [(1, answer)])
    bench.run(20)
    assert bench.robot.validator.deadlines.misses_in_a_row == 9
    bench.clock.late = 5 * PERIOD_NS
    bench.run(1)
    assert bench.robot.validator.deadlines.misses_in_a_row == 10


def test_an_answer_to_a_skipped_tick_is_rejected():
    bench = active()
    bench.run(10)
    bench.clock.late = 2 * PERIOD_NS
    state = bench.run(1)
    assert bench.robot.validator.accept(0, bench.setpoint(state, tick=10), state.tick) == "unasked"
