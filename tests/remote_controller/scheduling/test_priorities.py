"""Priorities move as (15) says, without jumps, by the timeline and by what is asked meanwhile."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol.config.settings import parse
from hoap3.remote_controller.scheduling.priorities import Priorities, PrioritySettings

ABC = ("a", "b", "c")
unit = st.floats(0.0, 1.0).filter(lambda share: share == 0.0 or share > 1e-30)


def priorities(content=None, names=ABC):
    settings = parse(PrioritySettings, content or {}, "x.yaml", "priorities")
    return Priorities(names, settings)


def fifteen(share):
    return 0.5 - 0.5 * math.cos(math.pi * share)


def test_without_order_and_matrix_no_task_is_above_another():
    assert not priorities().alpha.any()


def test_an_order_keeps_lower_tasks_out_of_higher_ones_and_leaves_levels_alone():
    found = priorities({"order": ["b", ["a", "c"]]}).alpha
    assert np.array_equal(found, [[0, 1, 0], [0, 0, 0], [0, 1, 0]])


def test_a_matrix_is_taken_as_it_stands_cycles_and_diagonal_included():
    rows = [[0.5, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.25, 1.0]]
    assert np.array_equal(priorities({"matrix": rows}).alpha, rows)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.75, 0.999])
def test_a_pair_follows_15_and_its_partner_the_rest_to_1(share):
    change = {"at_s": 1.0, "over_s": 2.0, "set": [["a", "b", 1.0]]}
    moved = priorities({"order": ["a", "b", "c"], "timeline": [change]})
    moved.update(1.0 + 2.0 * share)
    assert moved.alpha[0, 1] == pytest.approx(fifteen(share), abs=1e-15)
    assert moved.alpha[1, 0] == pytest.approx(1.0 - fifteen(share), abs=1e-15)
    assert moved.moving
    expected = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]])
    others = ~np.eye(3, dtype=bool)
    others[0, 1] = others[1, 0] = False
    assert np.array_equal(moved.alpha[others], expected[others])


def test_at_its_end_a_transition_is_exact_and_over():
    change = {"at_s": 0.1, "over_s": 0.3, "set": [["a", "b", 0.7]]}
    moved = priorities({"timeline": [change]})
    assert moved.update(0.3)
    assert moved.moving
    assert moved.update(0.4)
    assert not moved.moving
    assert (moved.alpha[0, 1], moved.alpha[1, 0]) == (0.7, 1.0 - 0.7)
    assert not moved.update(0.5)


def test_both_entries_of_a_pair_can_be_set():
    moved = priorities({"order": ["a", "b", "c"]})
    moved.change({"set": [["a", "b", 0.25], ["b", "a", 0.5]]}, 0.0)
    assert moved.update(0.0)
    assert (moved.alpha[0, 1], moved.alpha[1, 0]) == (0.25, 0.5)


def test_an_entry_of_the_diagonal_has_no_partner():
    moved = priorities()
    moved.change({"set": [["b", "b", 1.0]]}, 0.0)
    moved.update(0.0)
    assert moved.alpha.sum() == moved.alpha[1, 1] == 1.0


def test_several_pairs_move_at_once_each_in_its_own_time():
    moved = priorities(
        {
            "order": ["a", "b", "c"],
            "timeline": [
                {"at_s": 0.0, "over_s": 4.0, "set": [["a", "b", 1.0]]},
                {"at_s": 1.0, "over_s": 2.0, "set": [["b", "c", 1.0]]},
            ],
        }
    )
    moved.update(2.0)
    assert moved.alpha[0, 1] == pytest.approx(0.5)
    assert moved.alpha[1, 2] == pytest.approx(0.5)
    moved.update(3.0)
    assert moved.alpha[1, 2] == 1.0
    assert moved.alpha[0, 1] == pytest.approx(fifteen(0.75))


def test_an_order_of_some_tasks_leaves_the_others_alone():
    moved = priorities({"order": ["a", "b", "c"]})
    moved.change({"order": ["c", "a"]}, 0.0)
    moved.update(0.0)
    assert np.array_equal(moved.alpha, [[0, 0, 1], [1, 0, 0], [0, 1, 0]])


def test_a_removed_task_heeds_all_and_is_heeded_by_none_and_comes_back_as_it_was():
    rows = [[0.0, 0.2, 0.3], [0.4, 0.1, 0.6], [0.7, 0.8, 0.0]]
    moved = priorities({"matrix": rows})
    moved.change({"remove": "b", "over_s": 1.0}, 0.0)
    moved.update(0.5)
    assert moved.alpha[1, 1] == pytest.approx(0.55)
    moved.update(1.0)
    assert np.array_equal(moved.alpha, [[0, 0, 0.3], [1, 1, 1], [0.7, 0, 0]])
    moved.change({"insert": ["b"], "over_s": 1.0}, 2.0)
    moved.update(2.5)
    assert moved.alpha[0, 1] == pytest.approx(0.1)
    moved.update(3.0)
    assert np.array_equal(moved.alpha, rows)


def test_an_inactive_task_is_inserted_with_the_priorities_set_meanwhile():
    moved = priorities({"order": ["a", "b", "c"], "inactive": ["c"]})
    assert np.array_equal(moved.alpha[2], [1, 1, 1])
    assert not moved.alpha[:2, 2].any()
    moved.change({"set": [["a", "c", 0.75]]}, 0.0)
    assert not moved.update(0.0), "nothing moves while the task takes no part"
    moved.change({"insert": "c"}, 1.0)
    moved.update(1.0)
    assert (moved.alpha[0, 2], moved.alpha[2, 0]) == (0.75, 0.25)


def test_setting_a_pair_does_not_hasten_a_removal():
    moved = priorities({"order": ["a", "b", "c"]})
    moved.change({"remove": "a", "over_s": 2.0}, 0.0)
    moved.update(1.0)
    before = moved.alpha.copy()
    moved.change({"set": [["a", "b", 0.5]]}, 1.0)
    moved.update(1.0)
    assert np.array_equal(moved.alpha, before)


def test_a_change_at_once_is_there_at_once_and_the_next_update_tells_it():
    moved = priorities({"order": ["a", "b", "c"]})
    moved.change({"set": [["a", "b", 0.5]]}, 1.0)
    assert moved.shown()["alpha"][0][1] == 0.5
    assert not moved.shown()["moving"]
    assert moved.update(1.001)
    assert not moved.update(1.002)


def test_tasks_that_are_out_are_shown():
    moved = priorities({"order": ["a", "b", "c"], "inactive": ["c"]})
    moved.change({"remove": "a", "over_s": 1.0}, 0.0)
    assert (moved.shown()["out"], moved.shown()["moving"]) == (["a", "c"], True)
    moved.change({"insert": ["c"]}, 2.0)
    assert moved.shown()["out"] == ["a"]


def test_a_live_change_in_the_middle_of_a_transition_begins_there():
    change = {"at_s": 0.0, "over_s": 2.0, "set": [["a", "b", 1.0]]}
    moved = priorities({"order": ["a", "b", "c"], "timeline": [change]})
    moved.update(0.5)
    there = moved.alpha[0, 1]
    moved.change({"set": [["a", "b", 0.0]], "over_s": 1.0}, 0.5)
    assert moved.alpha[0, 1] == there
    moved.update(1.0)
    assert moved.alpha[0, 1] == pytest.approx(0.5 * there)
    moved.update(1.5)
    assert moved.alpha[0, 1] == 0.0
    assert not moved.moving


def test_the_timeline_takes_over_from_a_live_change_where_that_is():
    change = {"at_s": 1.0, "over_s": 1.0, "set": [["a", "b", 0.0]]}
    moved = priorities({"order": ["a", "b", "c"], "timeline": [change]})
    moved.change({"set": [["a", "b", 1.0]], "over_s": 2.0}, 0.0)
    moved.update(1.0)
    assert moved.alpha[0, 1] == pytest.approx(0.5)
    moved.update(1.5)
    assert moved.alpha[0, 1] == pytest.approx(0.25)


def test_reset_forgets_live_changes_and_begins_the_timeline_anew():
    change = {"at_s": 1.0, "set": [["a", "b", 1.0]]}
    content = {"order": ["a", "b", "c"], "inactive": ["c"], "timeline": [change]}
    moved, fresh = priorities(content), priorities(content)
    moved.change({"insert": "c"}, 0.0)
    moved.change({"order": ["c", "b", "a"], "over_s": 9.0}, 0.5)
    moved.update(2.0)
    moved.reset()
    assert not moved.moving
    assert np.array_equal(moved.alpha, fresh.alpha)
    moved.update(1.0)
    fresh.update(1.0)
    assert np.array_equal(moved.alpha, fresh.alpha)
    assert moved.alpha[0, 1] == 1.0


def test_update_tells_exactly_whether_alpha_changed():
    change = {"at_s": 1.0, "over_s": 1.0, "set": [["a", "b", 1.0]]}
    moved = priorities({"order": ["a", "b", "c"], "timeline": [change]})
    for tick in range(30):
        before = moved.alpha.copy()
        assert moved.update(0.1 * tick) == (not np.array_equal(before, moved.alpha))
        assert moved.moving == (10 <= tick < 20)


def test_alpha_stays_in_the_same_memory_and_updates_keep_nothing():
    moved = priorities({"order": ["a", "b", "c"]})
    alpha = moved.alpha
    moved.change({"order": ["c", "b", "a"], "over_s": 1e6}, 0.0)
    moved.update(0.5)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for tick in range(1000):
        moved.update(float(tick))
    kept = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert moved.alpha is alpha
    assert kept < 2000


@st.composite
def requests(draw):
    kind = draw(st.sampled_from(["set", "order"]))
    over = draw(st.sampled_from([0.25, 0.5, 2.0]))
    if kind == "order":
        return {"order": draw(st.permutations(ABC)), "over_s": over}
    a, b = draw(st.permutations(ABC))[:2]
    return {"set": [[a, b, draw(unit)]], "over_s": over}


@given(
    timeline=st.lists(st.tuples(unit, requests()), max_size=3),
    live=st.lists(st.tuples(st.integers(0, 200), requests()), max_size=4),
    toggles=st.lists(st.tuples(st.integers(0, 200), st.sampled_from(ABC)), max_size=4),
)
def test_whatever_is_asked_alpha_is_continuous_and_within_0_and_1(timeline, live, toggles):
    dated, at = [], 0.0
    for wait, request in timeline:
        dated.append({"at_s": at + wait, **request})
        at += wait + request["over_s"] + 0.01
    moved = priorities({"order": ["a", "b", "c"], "timeline": dated})
    out: set[str] = set()
    period, before = 0.01, moved.alpha.copy()
    # the steepest that (15) gets, with the shortest of these durations
    steepest = 0.5 * math.pi * period / 0.25
    for tick in range(201):
        time = tick * period
        for when, request in live:
            if when == tick:
                moved.change(request, time)
        for when, name in toggles:
            if when == tick:
                moved.change({"insert" if name in out else "remove": name, "over_s": 0.25}, time)
                out ^= {name}
        moved.update(time)
        assert ((moved.alpha >= 0.0) & (moved.alpha <= 1.0)).all()
        # one change may end and the next begin within a tick
        assert np.abs(moved.alpha - before).max() <= 1.001 * steepest
        before[:] = moved.alpha


@given(st.lists(st.floats(0.0, 6.0), min_size=1, max_size=20))
def test_alpha_depends_on_the_time_alone_not_on_which_ticks_were_seen(times):
    content = {
        "order": ["a", "b", "c"],
        "timeline": [
            {"at_s": 0.5, "over_s": 1.0, "order": ["c", "b", "a"]},
            {"at_s": 2.0, "over_s": 0.0, "remove": "b"},
            {"at_s": 2.5, "over_s": 3.0, "set": [["a", "c", 0.3]]},
            {"at_s": 5.5, "over_s": 1.0, "insert": "b"},
        ],
    }
    often, once = priorities(content), priorities(content)
    for time in sorted(times):
        often.update(time)
    once.update(max(times))
    assert np.abs(often.alpha - once.alpha).max() < 1e-12
