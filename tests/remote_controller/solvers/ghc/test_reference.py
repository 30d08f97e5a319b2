"""The kernels against the equations in plain numpy."""

from __future__ import annotations

import numpy as np
import pytest
from hierarchy_problems import Hierarchy
from row_problems import Rows, limits, with_rows
from support.solvers.one_shot import generalized_projector
from test_rows import solver_for

from hoap3.remote_controller.solvers.base import status as codes
from hoap3.remote_controller.solvers.ghc import reference


def solved(it: Hierarchy, rows: Rows) -> tuple[np.ndarray, float] | None:
    """By the reference, from the tasks on: q̈ and its condition number."""
    S, q0 = reference.condensed(it.jacobians, it.targets, it.alpha, it.w_r)
    G, h, equations = limits(it, rows)
    G, h = np.vstack([G, -G[:equations]]), np.concatenate([h, -h[:equations]])
    length = np.linalg.norm(G, axis=1)
    length[length == 0.0] = 1.0
    w = 0.0 if it.regularise == "none" else it.w_r
    pull = it.bias * (it.regularise == "torque")
    return reference.optimum(S, q0, w, it.M, pull, G / length[:, None], h / length)


def same_answers(seeds: range) -> int:
    """Compare statuses and q̈; how many problems had an answer.

    Within 1e-10 of 1 + |q̈|, and 1e-13 κ where that is more: κ is the condition number of S times
    that of the normals of the active rows, and of either computation the rounding grows with it.
    """
    answers = 0
    for seed in seeds:
        it, rows = with_rows(seed)
        solver, status = solver_for(it, rows)
        found = solved(it, rows)
        assert (status == codes.OK) == (found is not None), seed
        if found is not None:
            qdd, condition = found
            off = np.abs(solver.qdd - qdd).max() / (1.0 + np.abs(qdd).max())
            assert off <= max(1e-10, 1e-13 * condition), (seed, off, condition)
            answers += 1
    return answers


def test_the_condensed_problem_and_its_optimum():
    assert same_answers(range(200)) > 80


@pytest.mark.long
def test_the_condensed_problem_and_its_optimum_on_thousands():
    assert same_answers(range(1000, 6200)) > 2000


def same_projectors(seeds: range) -> None:
    """Exact and smoothed, of random, repeated and zero rows with ties among the priorities.

    Within 1e-10, and 1e-14 κ of the rows where that is more; the smoothed one is well conditioned.
    """
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, m = rng.integers(1, 9), rng.integers(1, 12)
        J = rng.normal(size=(m, n))
        for row in np.flatnonzero(rng.random(m) < 0.3):
            J[row] = rng.choice([0.0, 1.0, -2.0]) * J[rng.integers(m)]
        alpha = rng.choice([0.0, 0.3, 1.0, rng.random()], size=m)
        exact = reference.projector(alpha, J)
        off, allowed = np.abs(generalized_projector(alpha, J) - exact).max(), 1e-14 * condition(J)
        assert off < max(1e-10, allowed), seed
        width = 10.0 ** rng.uniform(-1, 0.5)
        smooth = reference.projector(alpha, J, width)
        found = generalized_projector(alpha, J, smoothing=width)
        assert np.abs(found - smooth).max() < 1e-10, seed


def condition(J: np.ndarray) -> float:
    """Of rows, without the singular values that are rounding."""
    spread = np.linalg.svd(J, compute_uv=False)
    kept = spread[spread > 1e-8 * spread[0]] if spread[0] > 0.0 else np.ones(1)
    return float(kept[0] / kept[-1])


def test_the_projector():
    same_projectors(range(300))


@pytest.mark.slow
def test_the_projector_on_thousands():
    same_projectors(range(1000, 6000))
