"""The dual active set against the plain reference, and the reference against brute force."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pytest
from support.amounts import seed_ranges
from test_qp_backends import random_program

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.qp.active_set import ActiveSet
from hoap3.remote_controller.solvers.qp.dense_qp import NO_BOUND, Program
from hoap3.remote_controller.solvers.qp.reference import solve_qp

SEEDS = seed_ranges(300, 1100, 5300)


def arrays(program: Program) -> tuple[np.ndarray, ...]:
    """As the reference takes them."""
    V = np.vstack([np.eye(program.f.size), program.A])
    least = np.where(program.least <= -NO_BOUND, -np.inf, program.least)
    most = np.where(program.most >= NO_BOUND, np.inf, program.most)
    return program.H, -program.f, V, least, most


def by_brute_force(H, f, V, least, most) -> np.ndarray | None:
    """The cheapest of all points within all sides that are best where some of these hold."""
    n, best, least_cost = f.size, None, np.inf
    for count in range(n + 1):
        for rows in combinations(range(len(V)), count):
            for sides in product((least, most), repeat=count):
                held = np.array([side[row] for side, row in zip(sides, rows, strict=True)])
                N = V[list(rows)]
                kkt = np.block([[H, N.T], [N, np.zeros((count, count))]])
                if not np.isfinite(held).all() or np.linalg.cond(kkt) > 1e12:
                    continue
                x = np.linalg.solve(kkt, np.concatenate([f, held]))[:n]
                cost = 0.5 * x @ H @ x - f @ x
                within = (V @ x >= least - 1e-9).all() and (V @ x <= most + 1e-9).all()
                if within and cost < least_cost:
                    best, least_cost = x, cost
    return best


@pytest.mark.parametrize("seeds", SEEDS)
def test_the_kernel_finds_what_the_reference_finds(seeds):
    """To 1e-10 of the largest value, where κ(H) ≤ 1e5; κ·1e-15 beyond that."""
    for seed in seeds:
        program = random_program(seed)
        found, x, _ = ActiveSet(program).solve()
        expected = solve_qp(*arrays(program))
        assert found == status.OK
        rounding = max(1e-10, 1e-15 * np.linalg.cond(program.H))
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(x, expected, rtol=0, atol=rounding * scale)


@pytest.mark.parametrize("seeds", SEEDS)
def test_both_find_the_same_problems_without_a_solution(seeds):
    none = 0
    for seed in seeds:
        program, rng = random_program(seed), np.random.default_rng([seed, 2])
        program.least[-1] = program.most[-1] = 6.0 * rng.normal() * np.linalg.norm(program.A[-1])
        found, _, _ = ActiveSet(program).solve()
        expected = solve_qp(*arrays(program))
        assert found == (status.INFEASIBLE if expected is None else status.OK)
        none += expected is None
    assert none > len(seeds) // 5


def test_the_reference_is_the_best_of_all_active_sets():
    checked = 0
    for seed in range(400):
        program = random_program(seed)
        if program.f.size > 3 or len(program.A) > 3:
            continue
        expected = by_brute_force(*arrays(program))
        np.testing.assert_allclose(solve_qp(*arrays(program)), expected, atol=1e-8)
        checked += 1
    assert checked > 30
