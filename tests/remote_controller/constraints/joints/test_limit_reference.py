"""Limits of speeds and of margins against (25) in plain numpy.

The rule: 1e-10 of the largest of what is added up.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.amounts import AMOUNTS, seed_ranges

from hoap3.remote_controller.constraints import limit_kernels as kernels
from hoap3.remote_controller.constraints import limit_reference as plain

SEEDS = seed_ranges(1000, 1800, 6000)
many = pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)


def near(found: np.ndarray, expected: np.ndarray) -> None:
    finite = np.abs(expected[np.isfinite(expected)])
    within = 1e-10 * (1.0 + finite.max(initial=0.0))
    np.testing.assert_allclose(found, expected, rtol=0, atol=within)


def interval(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    least, most = np.sort(rng.normal(size=(2, n)), axis=0)
    return least, most


@many
def test_intervals_are_those_of_the_limits(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, (eta, v_r, T) = int(rng.integers(1, 12)), 10.0 ** rng.uniform(-2, 1, 3)
        q, dq = rng.normal(size=(2, n))
        least, most = interval(rng, n)
        brake, speed = rng.exponential(size=(2, n))
        own, margins = interval(rng, n), np.empty(2 * n)

        found = [each.copy() for each in own]
        kernels.intersect_box(least, most, *found)
        near(np.array(found), np.array(plain.meet(own, (least, most))))

        found = [each.copy() for each in own]
        kernels.change_within(dq, speed, brake, T, *found)
        near(np.array(found), np.array(plain.meet(own, plain.speed_changes(dq, speed, brake, T))))

        found = [each.copy() for each in own]
        smallest = kernels.narrow_to_range(q, least, most, eta, v_r, margins, *found)
        bounds = plain.range_bounds(q, least, most, eta, v_r)
        near(np.array(found), np.array(plain.meet(own, bounds)))
        near(margins, np.hstack([q - least, most - q]))
        assert smallest == margins.min()


@many
def test_rows_are_those_of_25_and_of_its_second_order(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, s = int(rng.integers(1, 12)), int(rng.integers(1, 9))
        margins, bend, A, dq = *rng.normal(size=(2, s)), rng.normal(size=(s, n)), rng.normal(size=n)
        A[rng.random(s) < 0.2] = 0.0
        eta, r, v_r = 10.0 ** rng.uniform(-2, 1, 3)
        lost = int((np.all(A == 0.0, axis=1) & (margins < 0.0)).sum())

        rows, b = A.copy(), np.empty(s)
        assert kernels.limit_rows(margins, eta, r, v_r, rows, b) == (margins.min(), lost)
        expected = plain.rows(margins, A, eta, r, v_r)
        near(rows, expected[0])
        near(b, expected[1])

        rows = A.copy()
        told = kernels.limit_accelerations(margins, dq, bend, eta, r, v_r, rows, b)
        assert told == (margins.min(), lost)
        expected = plain.accelerations(margins, A, dq, bend, eta, r, v_r)
        near(rows, expected[0])
        near(b, expected[1])


@many
def test_returns_are_slowed_and_rows_that_hold_are_named(seeds):
    named = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, s = int(rng.integers(1, 12)), int(rng.integers(1, 9))
        A, b, box, x = rng.normal(size=(s, n)), rng.normal(size=s), interval(rng, n), rng.random(n)
        slow = b.copy()
        kernels.slow_returns(A, slow, *box)
        near(slow, plain.slow_returns(A, b, box))

        sides, owners = np.array(interval(rng, s)), rng.integers(0, 5, s)
        end, value = rng.integers(0, 4, s), A @ x
        sides[0, end == 0] = value[end == 0]  # one side holds
        sides[1, end == 0] = value[end == 0] + 1.0
        sides[:, end == 1] = value[end == 1]  # an equation
        sides[:, end == 2] = np.array([[-np.inf], [np.inf]])
        edge = np.flatnonzero(end == 3)  # just within what counts as held, or just beyond
        reach = kernels.AT_END * (1.0 + np.abs(A * x).sum(axis=1))
        sides[0, edge] = (value - reach * rng.choice([0.9, 1.1], s))[edge]
        sides[1, edge] = sides[0, edge] + 1.0
        owned = plain.held(A, x, (sides[0], sides[1]), owners, kernels.AT_END)
        assert kernels.held_rows(A, *sides, x, owners) == sum(1 << i for i in owned)
        named += len(owned)
    assert named > len(seeds)
