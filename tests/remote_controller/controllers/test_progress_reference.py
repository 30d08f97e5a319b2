"""The kernel that finds tasks without progress against plain numpy; flags are equal."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.remote_controller.controllers.progress_kernels import FLAT, HELD, STUCK, find_progress
from hoap3.remote_controller.controllers.progress_reference import progress

T = 1e-3


def problem(rng):
    """Up to four tasks: some stationary, without error, or held by bounds and ends of the range."""
    n, sizes = int(rng.integers(1, 9)), rng.integers(1, 4, int(rng.integers(1, 5)))
    stops = np.cumsum(sizes)
    spans = np.stack([stops - sizes, stops], axis=1).astype(np.int64)
    jacobian, errors = rng.standard_normal((stops[-1], n)), rng.standard_normal(stops[-1])
    for first, end in spans:
        J, e = jacobian[first:end], errors[first:end]
        kind = rng.integers(4)
        if kind == 0:  # no joint changes the direction of e, but for 1e-7 or 1e-5 of it
            J -= np.outer(e, e @ J) / (e @ e)
            J += 10.0 ** rng.choice([-7.5, -4.5]) * np.outer(e, rng.standard_normal(n))
        elif kind == 1:
            e[:] = 0.0
    velocity = rng.standard_normal(n) * rng.choice([0.0, 1e-5, 1.0], n)
    lower, upper = -1.0 - rng.random(n), 1.0 + rng.random(n)
    decided = np.where(rng.random(n) < 0.4, rng.choice([lower, upper]), 0.0)
    reference = np.zeros(n)
    ends = np.array([-rng.random(n), rng.random(n)]) * rng.choice([0.0, 1.0, np.inf], (2, n))
    ends[np.isnan(ends)] = 0.0
    return errors, jacobian, spans, velocity, decided, lower, upper, reference, ends


@pytest.mark.parametrize("problems", [400, pytest.param(5000, marks=pytest.mark.slow)])
def test_flags_are_those_of_the_definitions(problems):
    rng, seen = np.random.default_rng(0), 0
    for _ in range(problems):
        errors, jacobian, spans, velocity, decided, lower, upper, reference, ends = problem(rng)
        sign = float(rng.choice([-1.0, 1.0]))
        flat, stuck = np.zeros((2, len(spans)), bool)
        held = np.zeros((len(spans), velocity.size), bool)
        found = find_progress(
            *(sign * errors, jacobian, spans, sign, velocity, decided, lower, upper),
            *(reference, ends, T, flat, stuck, held),
        )
        steps = (ends[0] - reference) / T, (ends[1] - reference) / T
        expected = [
            progress(
                *(errors[first:end], jacobian[first:end], velocity, decided),
                *((lower, upper), steps),
            )
            for first, end in spans
        ]
        assert flat.tolist() == [each[0] for each in expected]
        assert stuck.tolist() == [each[1] for each in expected]
        assert held.tolist() == [each[2].tolist() for each in expected]
        assert found == FLAT * flat.any() + STUCK * stuck.any() + HELD * held.any()
        seen |= found
    assert seen == FLAT + STUCK + HELD
