"""Tangents and velocities along curves against their equations in plain numpy.

The rule: 1e-10 where the gradients have condition κ ≤ 1000, 1e-13 κ beyond; relative to 1 + the
largest entry.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.amounts import AMOUNTS, seed_ranges

from hoap3.remote_controller.tasks.curve_following.curve_kernels import (
    curve_tangent,
    curve_velocity,
)
from hoap3.remote_controller.tasks.curve_following.curve_reference import tangent, velocity

SEEDS = seed_ranges(500, 1400, 6000)


@pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)
def test_tangent_and_velocity_are_those_of_22_and_23(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        m = int(rng.integers(2, 7))
        g = rng.normal(size=(m - 1, m)) * 10.0 ** rng.uniform(-2, 2, size=(m - 1, 1))
        if seed % 3 == 0 and m > 2:
            g[-1] = g[0] + 10.0 ** rng.uniform(-5, 0) * rng.normal(size=m)
        alpha, weights = rng.normal(size=m - 1), 10.0 ** rng.uniform(-1, 1, m - 1)
        last = rng.normal(size=m) * (seed % 2)
        direction, speed, decrease = float(rng.choice([-1, 1])), rng.normal(), rng.random()
        rows, factor, work = np.zeros((3, m, m))
        T, out = np.zeros(m), np.zeros(m)
        independence, _ = curve_tangent(g, direction, last, rows, factor, work, T)
        assert independence > 0.0
        assert curve_velocity(alpha, weights, rows, factor, T, speed, decrease, np.zeros(m), out)
        within = max(1e-10, 1e-13 * np.linalg.cond(g))
        wanted = tangent(g, direction, last)
        np.testing.assert_allclose(T, wanted, rtol=0, atol=within)
        expected = velocity(g, alpha, weights, wanted, speed, decrease)
        size = 1.0 + np.abs(expected).max()
        np.testing.assert_allclose(out, expected, rtol=0, atol=within * size)
