"""What stalls come to; those by a limit of CPU time against those that come anyhow."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hoap3.tools.machine.stalls import PERIOD_NS, Stall, ended_in_step, figures

MS = 1_000_000


def test_figures_say_how_many_how_long_and_the_longest():
    assert figures([Stall(0, 2_000_000), Stall(5_000_000, 5_500_000)]) == {
        "n": 2,
        "total_ms": 2.5,
        "longest_ms": 2.0,
        "long": 1,
        "in_step": 0,
    }


def anywhere(rng, count):
    ends = rng.integers(0, 60_000 * MS, count)
    return [Stall(int(end) - int(rng.integers(MS, 9 * MS)), int(end)) for end in ends]


@given(seed=st.integers(0, 2**32 - 1), phase=st.integers(0, PERIOD_NS - 1))
def test_stalls_that_end_with_the_period_are_told_from_others(seed, phase):
    rng = np.random.default_rng(seed)
    periods = np.sort(rng.choice(600, 20, replace=False))
    limited = [
        Stall(end - int(rng.integers(MS, 9 * MS)), end)
        for end in (periods * PERIOD_NS + phase + rng.integers(-MS // 3, MS // 3, 20)).tolist()
    ]
    found = ended_in_step([*limited, *anywhere(rng, 10)])
    assert 20 <= found["in_step"] <= found["long"] <= 30


@given(seed=st.integers(0, 2**32 - 1))
def test_stalls_that_end_anywhere_are_not_in_step(seed):
    rng = np.random.default_rng(seed)
    assert ended_in_step(anywhere(rng, int(rng.integers(0, 60))))["in_step"] == 0


def test_what_two_cpus_saw_at_once_is_one_stall():
    twice = [Stall(end - 5 * MS, end + late) for end in (10 * MS, 777 * MS) for late in (0, 9)]
    assert ended_in_step(twice) == {"long": 2, "in_step": 0}


def test_of_many_the_newest_count():
    ends = [*range(0, 300 * 37 * MS, 37 * MS), *range(10**12, 10**12 + 100 * PERIOD_NS, PERIOD_NS)]
    found = ended_in_step([Stall(end - MS, end) for end in ends])
    assert found == {"long": 100, "in_step": 100}


def test_short_stalls_do_not_count():
    short = [Stall(k * PERIOD_NS, k * PERIOD_NS + MS - 1) for k in range(50)]
    assert ended_in_step(short) == {"long": 0, "in_step": 0}
