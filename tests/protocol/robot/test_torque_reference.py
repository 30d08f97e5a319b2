"""Algorithm 4 against Newton's and Euler's equations in plain numpy, on random trees.

The rule: 1e-10, relative to the largest entry of what is compared: nothing is inverted.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.robots.random_trees import random_tree

from hoap3.protocol.robot import torque_bounds_kernels as kernels
from hoap3.protocol.robot.link_tables import build_tree
from hoap3.protocol.robot.pinocchio_model import build_model
from hoap3.protocol.robot.torque_bounds_reference import bias_and_inertia, possible

SEEDS = [range(20), pytest.param(range(20, 520), marks=pytest.mark.slow)]
STATES = 10  # of each tree


def near(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("seeds", SEEDS, ids=["some", "many"])
def test_bias_inertia_and_accelerations_are_those_of_the_equations(seeds):
    for seed in seeds:
        rng, n = np.random.default_rng(seed), 1 + seed % 9
        tree = build_tree(build_model(random_tree(seed, n)))
        limits = np.vstack([-rng.uniform(0.1, 3, n), *rng.uniform(0.1, 3, (2, n))])
        limits = np.vstack([limits, rng.uniform(1, 100, n)])
        bias, inertia, work = np.empty(n), np.empty(n), np.empty((n, kernels.WORK))
        for _ in range(STATES):
            drawn, nothing = rng.random((1, 2 * n)), np.full((2, n), np.inf) * [[-1.0], [1.0]]
            q = limits[0] + drawn[0, :n] * (limits[1] - limits[0])
            dq = limits[2] * (2.0 * drawn[0, n:] - 1.0)
            kernels.bias_and_inertia(kernels.Links(*tree.tables), q, dq, work, bias, inertia)
            h, M = bias_and_inertia(tree, q, dq)
            near(bias, h)
            near(inertia, M)
            states = np.zeros((2, n, 2, n))
            kernels.sample(*tree.tables, limits, False, drawn, nothing, states)
            near(nothing, np.array(possible(tree, q, dq, limits[3])))
