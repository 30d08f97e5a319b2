"""Inertia and accelerations of tied joints against plain numpy, on random laws.

The rule: 1e-10, relative to the largest entry of what is compared, and for accelerations 1e-14 κ
where that is more, κ the condition of what is inverted.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.amounts import AMOUNTS, seed_ranges

from hoap3.protocol.robot import mimic_joints_kernels as kernels
from hoap3.protocol.robot import mimic_joints_oracle as reference

SEEDS = seed_ranges(200, 1000, 5200)


@pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)
def test_inertia_and_accelerations_are_those_of_the_matrices(seeds):
    for seed in seeds:
        rng, n, f = np.random.default_rng(seed), 1 + seed % 7, seed % 6
        m = n + f
        order, mimicked = rng.permutation(m), np.append(np.arange(n), rng.integers(n, size=f))
        multipliers = np.append(np.ones(n), rng.normal(size=f))
        G = np.zeros((m, n))
        G[order, mimicked] = multipliers
        root = rng.normal(size=(m, m))
        full = root @ root.T + 0.01 * np.eye(m)
        upper = np.triu(full) + np.tril(rng.normal(size=(m, m)), -1)  # of which nothing is read
        mass, ddq = np.empty((n, n)), np.empty(n)
        kernels.tied_inertia(upper, order, mimicked, multipliers, mass)
        expected = reference.tied_inertia(upper, G)
        np.testing.assert_allclose(mass, expected, atol=1e-10 * np.abs(expected).max())
        np.testing.assert_array_equal(mass, mass.T)

        added, torque = rng.uniform(0.0, 1.0, n), rng.normal(size=n)
        kernels.accelerations(mass, added, torque, np.empty((n, n)), ddq)
        expected = reference.accelerations(mass, added, torque)
        near = max(1e-10, 1e-14 * np.linalg.cond(mass + np.diag(added)))
        np.testing.assert_allclose(ddq, expected, atol=near * np.abs(expected).max())


def test_what_is_no_inertia_gives_no_number():
    ddq = np.empty(1)
    kernels.accelerations(-np.eye(1), np.zeros(1), np.ones(1), np.empty((1, 1)), ddq)
    assert np.isnan(ddq).all()
