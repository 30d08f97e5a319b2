"""The bounds of the acceleration against their meaning, in plain numpy.

The rule: 1e-10 of the largest acceleration, and 16 units in the last place of the range over T²,
which is as well as an acceleration is known where positions are.
"""

from __future__ import annotations

import numpy as np
import pytest
from viability import States, random_states

from hoap3.protocol.limits.viability_bounds import AccelerationBounds
from hoap3.protocol.limits.viability_bounds_oracle import bounds, naive_bounds

COUNTS = [500, pytest.param(20_000, marks=pytest.mark.slow)]


def known(states: States) -> np.ndarray:
    """How well an acceleration is known."""
    span = np.maximum(np.abs(states.lower), np.abs(states.upper))
    largest = np.maximum(states.up, states.down)
    return 1e-10 * largest + 16.0 * np.spacing(span) / states.T**2


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("even", [True, False], ids=["symmetric", "asymmetric"])
@pytest.mark.parametrize("T", [1e-3, 0.01, 0.1])
def test_they_are_what_can_be_held(T, even, count):
    states = random_states(np.random.default_rng(5), count, T, even=even)
    solver = AccelerationBounds(*states.limits, T, deceleration=states.down)
    least, most = np.empty(count), np.empty(count)
    solver.solve(states.q, states.v, least, most)
    limits = states.speed, states.up, states.down
    lowest, greatest = bounds(states.above, states.below, states.v, *limits, T)
    close = known(states)
    assert np.all(np.abs(most - greatest) <= close)
    assert np.all(np.abs(least - lowest) <= close)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("T", [1e-3, 0.01, 0.1])
def test_naive_ones_are_those_of_2(T, count):
    states = random_states(np.random.default_rng(6), count, T)
    solver = AccelerationBounds(*states.limits, T, naive=True)
    least, most = np.empty(count), np.empty(count)
    solver.solve_naive(states.q, states.v, least, most)
    lowest, greatest = naive_bounds(
        states.above, states.below, states.v, states.speed, states.up, T
    )
    apart = lowest <= greatest
    assert apart.mean() > 0.5
    close = known(states)[apart]
    assert np.all(np.abs(most - greatest)[apart] <= close)
    assert np.all(np.abs(least - lowest)[apart] <= close)
