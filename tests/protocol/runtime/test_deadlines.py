"""Deadlines against a recount of everything that happened, and the verdict."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol.runtime.deadlines import WINDOW, Deadlines

WINDOWS = st.sampled_from([1, 2, 5, WINDOW])
STEPS = st.lists(
    st.sampled_from(["hit"] * 6 + ["late", "lost", "lost", "arrived", "end_run"]), max_size=300
)


@given(window=WINDOWS, steps=STEPS)
def test_every_figure_is_what_a_recount_gives(window, steps):
    deadlines = Deadlines(window)
    outcomes: list[bool] = []  # whether each tick was answered in time
    late = lost = run = longest = 0
    rates: list[float] = []
    for step in steps:
        if step == "arrived":
            if not lost:
                continue
            deadlines.lost_arrived()
            lost, late = lost - 1, late + 1
        elif step == "end_run":
            deadlines.end_run()
            run = 0
        else:
            if step == "hit":
                deadlines.hit()
            else:
                deadlines.miss(arrived=step == "late")
            late, lost = late + (step == "late"), lost + (step == "lost")
            outcomes.append(step == "hit")
            run = 0 if outcomes[-1] else run + 1
            longest = max(longest, run)
            if len(outcomes) >= window:
                rates.append(sum(outcomes[-window:]) / window)
        recent = outcomes[-window:]
        assert deadlines.asked == len(outcomes)
        assert deadlines.in_time == sum(outcomes)
        assert (deadlines.late, deadlines.lost) == (late, lost)
        assert deadlines.late + deadlines.lost == len(outcomes) - sum(outcomes)
        assert (deadlines.misses_in_a_row, deadlines.longest_run) == (run, longest)
        assert deadlines.success_rate == (sum(recent) / len(recent) if recent else 1.0)
        assert deadlines.run_rate == (sum(outcomes) / len(outcomes) if outcomes else 1.0)
        assert deadlines.worst_window == (min(rates) if rates else None)


def test_the_window_is_100_ticks_and_forgets_what_is_older():
    deadlines = Deadlines()
    for _ in range(100):
        deadlines.miss(arrived=False)
    for hits in range(1, 101):
        deadlines.hit()
        assert deadlines.success_rate == hits / 100
    assert deadlines.run_rate == 0.5
    assert deadlines.worst_window == 0.0
