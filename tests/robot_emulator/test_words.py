"""The words of the loop, as docs/concepts.md defines them, on virtual time."""

from __future__ import annotations

import numpy as np
import pytest
from support.robot_bench import active
from support.small_arm import PERIOD_NS

from hoap3.protocol.messages import State
from hoap3.robot_emulator.setpoint_validator import HISTORY

US = 1000


@pytest.mark.parametrize(
    ("delay", "late"),
    [(PERIOD_NS - US, 0), (PERIOD_NS, 0), (PERIOD_NS + 1, 1), (PERIOD_NS + US, 1)],
)
def test_the_deadline_is_the_intended_start_of_the_next_tick(delay, late):
    bench = active(fate=lambda tick, answer: [(delay if tick == 5 else 1, answer)])
    bench.run(6)
    bench.clock.late = 5 * US  # so that a late answer is there before the actual wake-up
    state = bench.run(1)
    assert (state.late, state.lost) == (late, 0)
    assert bench.robot.validator.deadlines.in_time == 6 - late


def test_an_answer_between_deadline_and_wake_up_is_used_and_counted_late():
    bench = active(
        fate=lambda tick, answer: [(PERIOD_NS + 2 * US, answer)] if tick == 5 else [(1, answer)]
    )
    bench.speed[:] = 0.1
    bench.run(6)
    before = bench.states()[-1].reference.copy()
    bench.clock.late = 10 * US
    state = bench.run(1)
    np.testing.assert_allclose(state.reference, before + 1e-4)
    assert (state.late, state.lost) == (1, 0)
    assert bench.robot.validator.deadlines.misses_in_a_row == 1


def test_an_answer_after_the_wake_up_is_lost_until_it_comes_and_then_late():
    bench = active(
        fate=lambda tick, answer: [(PERIOD_NS + 500 * US, answer)] if tick == 5 else [(1, answer)]
    )
    state = bench.run(7)
    assert (state.late, state.lost) == (0, 1)
    state = bench.run(1)
    assert (state.late, state.lost) == (1, 0)
    assert state.out_of_order == 1  # tick 6 was answered at once, before the one for tick 5 came


def test_a_lost_answer_stays_lost():
    bench = active(fate=lambda tick, answer: [] if tick == 5 else [(1, answer)])
    state = bench.run(20)
    assert (state.late, state.lost, state.duplicate, state.out_of_order) == (0, 1, 0, 0)
    assert state.success_rate == pytest.approx(18 / 19)


def test_a_duplicate_is_counted_once_and_changes_nothing():
    bench = active(fate=lambda tick, answer: [(1, answer), (2, answer)])
    bench.speed[:] = 0.1
    state = bench.run(11)
    assert state.duplicate == 10
    assert (state.late, state.lost) == (0, 0)
    np.testing.assert_allclose(state.reference, np.array([0.1, -0.2, 0.3]) + 10 * 1e-4)


def test_out_of_order_setpoints_are_not_followed():
    held: list[bytes] = []

    def fate(tick, answer):
        if tick == 5:
            held.append(answer)
            return []
        return [(1, answer), (2, held.pop())] if tick == 6 else [(1, answer)]

    bench = active(fate=fate)
    bench.speed[:] = 0.1
    state = bench.run(12)
    assert (state.out_of_order, state.duplicate) == (1, 0)
    assert (state.late, state.lost) == (1, 0)


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


def test_a_future_tick_by_one_is_rejected():
    bench = active(fate=lambda tick, answer: [])
    bench.run(3)
    state = bench.states()[-1]
    answer = bench.setpoint(state, tick=state.tick + 1)
    assert bench.robot.validator.accept(0, answer, state.tick) == "future"
    assert bench.robot.validator.accept(0, bench.setpoint(state), state.tick) is None


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_rejected(value):
    bench = active()
    bench.speed[1] = value
    state = bench.run(3)
    assert bench.robot.validator.rejections["not_finite"] == 2
    np.testing.assert_array_equal(state.reference, [0.1, -0.2, 0.3])


@pytest.mark.parametrize("payload", [b"", b"\0" * 10, b"\xff" * 336, bytes(10_000)])
def test_garbage_is_counted_and_harmless(payload):
    bench = active(fate=lambda tick, answer: [(1, payload), (2, answer)])
    state = bench.run(5)
    assert state.rejected == 4
    assert (state.late, state.lost) == (0, 0)


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


def test_a_safe_stop_brakes_within_the_limits_and_latches():
    lost = range(50, 1000)
    bench = active(
        fate=lambda tick, answer: [] if tick in lost else [(1, answer)], loss_policy="extrapolate"
    )
    bench.speed[:] = (1.0, -2.0, 0.5)
    bench.run(300)
    states = bench.states()
    reference = np.array([state.reference for state in states])
    rate = np.diff(reference, axis=0) / 1e-3
    braking = slice(69, None)
    acceleration = np.diff(rate[braking], axis=0) / 1e-3
    assert np.abs(acceleration).max() <= 40.0 * (1 + 1e-9)
    np.testing.assert_array_equal(reference[-1], reference[-2])
    assert states[-1].mode == State.STOPPED
    assert {state.mode for state in states} == {State.ACTIVE, State.STOPPING, State.STOPPED}
    assert bench.robot.validator.deadlines.longest_run == 20  # ticks after a stop are outside


def test_extrapolation_goes_on_as_before_and_hold_stays():
    for policy, rate in (("hold", 0.0), ("extrapolate", 1.0)):
        bench = active(
            fate=lambda tick, answer: [] if tick in range(50, 60) else [(1, answer)],
            loss_policy=policy,
        )
        bench.speed[:] = 1.0
        bench.run(59)
        states = bench.states()
        moved = states[-1].reference - states[52].reference
        np.testing.assert_allclose(moved, rate * 6 * 1e-3, atol=1e-12)


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


def test_a_wake_up_late_by_less_than_a_period_skips_nothing():
    bench = active()
    bench.run(3)
    bench.clock.late = PERIOD_NS - 1
    state = bench.run(1)
    assert (state.skipped, state.tick) == (0, 3)
    assert state.stamp_actual - state.stamp_intended == PERIOD_NS - 1


def test_an_answer_to_a_skipped_tick_is_rejected():
    bench = active()
    bench.run(10)
    bench.clock.late = 2 * PERIOD_NS
    state = bench.run(1)
    assert bench.robot.validator.accept(0, bench.setpoint(state, tick=10), state.tick) == "unasked"


def test_an_answer_to_a_tick_of_long_ago_is_rejected_also_where_none_was_asked_since():
    bench = active(fate=lambda tick, answer: [] if tick == 9 else [(1, answer)])
    state = bench.run(10)
    validator = bench.robot.validator
    late = bench.setpoint(state, tick=9)
    assert validator.accept(0, late, 9 + HISTORY) == "unasked"
    assert validator.accept(0, late, 8 + HISTORY) is None


def test_the_window_is_a_hundred_ticks():
    bench = active(fate=lambda tick, answer: [] if tick == 0 else [(1, answer)])
    rates = [bench.run(1).success_rate for _ in range(102)]
    assert rates[1] == 0.0
    assert rates[100] == pytest.approx(0.99)
    assert rates[101] == 1.0
    assert bench.robot.validator.deadlines.worst_window == pytest.approx(0.99)
