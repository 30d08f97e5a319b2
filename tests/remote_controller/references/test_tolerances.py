"""Tolerances are violated exactly when they are defined to be."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.references.trajectories.tolerances import Tolerances, each_of

NAMES, UNITS = ("elbow", "slide"), ("rad", "m")
PERIOD = 0.001
LIMIT = st.sampled_from([0.5, 1.0, 2.0, math.inf])
SIZE = st.sampled_from([-2.5, -1.0, -0.5, 0.0, 0.3, 0.5, 1.0, 2.0, 2.000001, math.nan, math.inf])


def defined(errors, path, goal, late, end):
    """Tick and component of the violation by its definition, over whole arrays; None for none."""
    ticks = np.arange(len(errors))
    within_path = (np.abs(errors) <= path).all(1)
    within_goal = (np.abs(errors) <= goal).all(1)
    on_the_way = np.flatnonzero(~within_path & (ticks < end))
    if len(on_the_way):
        return int(on_the_way[0]), "path"
    last = np.flatnonzero(ticks >= end + late)
    if not len(last) or np.isinf(goal).all():
        return None
    reached = within_goal[end : last[0] + 1].any()
    return None if reached else (int(last[0]), "goal")


@settings(max_examples=150)
@given(
    errors=st.lists(st.tuples(SIZE, SIZE), min_size=1, max_size=9),
    path=st.tuples(LIMIT, LIMIT),
    goal=st.tuples(LIMIT, LIMIT),
    end=st.integers(0, 8),
    late=st.integers(0, 4),
    begin=st.sampled_from([0, 123, 1_000_003]),
)
def test_a_violation_is_seen_at_its_tick_and_no_other(errors, path, goal, end, late, begin):
    rows, path, goal = np.array(errors), np.array(path), np.array(goal)
    judge = Tolerances(NAMES, UNITS, path, goal, late * PERIOD, end * PERIOD, holds=True)
    wanted = defined(rows, path, goal, late, end)

    first = begin * PERIOD  # times as a controller has them: tick × period, less the start's
    for again in range(2):
        judge.restart()
        seen = [
            judge.judge(row, (begin + tick) * PERIOD - first, begin + tick)
            for tick, row in enumerate(rows)
        ]
        assert sum(seen) == (wanted is not None), again
    if wanted is None:
        assert judge.violation is None
        return
    tick, where = wanted
    found = judge.violation
    assert seen[tick]
    assert (found.tick, found.where) == (begin + tick, where)
    i = NAMES.index(found.name)
    limit = (path if where == "path" else goal)[i]
    size = abs(rows[tick, i])
    assert (found.tolerance, found.unit) == (limit, UNITS[i])
    assert not size <= limit
    assert found.error == (size if math.isfinite(size) else math.inf)


@pytest.mark.parametrize("given_", [0.5, {"slide": 0.5}, None])
def test_a_number_is_for_all_and_a_name_for_one(given_):
    found = each_of(given_, NAMES, "path_tolerance")
    first = 0.5 if given_ == 0.5 else math.inf
    np.testing.assert_array_equal(found, [first, 0.5 if given_ is not None else math.inf])


def test_a_name_that_the_task_does_not_have_is_refused():
    with pytest.raises(ConfigError) as caught:
        each_of({"elbw": 1.0}, NAMES, "goal_tolerance")
    assert caught.value.key == "goal_tolerance.elbw"
    assert "elbow" in caught.value.remedy
