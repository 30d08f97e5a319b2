"""Kernels of prioritised tasks and constant gains against their equations in plain numpy.

The rule: 1e-10, relative to the largest entry of what is compared, where what is inverted has
condition κ ≤ 300, and 1e-15 κ² beyond.
"""

from __future__ import annotations

import numpy as np
import pytest
from clik_problems import Stack, stack
from support.amounts import AMOUNTS, seed_ranges

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.clik import clik_kernels, lmi_kernels
from hoap3.remote_controller.solvers.clik.clik_reference import (
    certified,
    prioritised,
    stability_matrix,
)
from hoap3.remote_controller.solvers.clik.constant_gains import ConstantGains
from hoap3.remote_controller.solvers.clik.constant_gains_kernels import ACCURACY
from hoap3.remote_controller.solvers.clik.constant_gains_reference import (
    constant_gains,
    feed_forward,
)

SEEDS = seed_ranges(500, 1400, 6000)


def close(found: np.ndarray, expected: np.ndarray, size: float, it: Stack) -> None:
    within = max(1e-10, 1e-15 * it.condition**2) * size
    np.testing.assert_allclose(found, expected, rtol=0, atol=within)


@pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)
def test_the_law_is_the_paper_s(seeds):
    for seed in seeds:
        it = stack(seed)
        n, joints = it.J.shape
        L, B, D = np.zeros((n, n)), np.zeros((n, joints)), np.sqrt(it.weights)
        basis = clik_kernels.Basis(
            np.zeros((n, joints)), *np.zeros((3, n, n)), np.zeros((n, 2 * n)), np.zeros(n)
        )
        rank = clik_kernels.prioritised(it.J, it.offsets, it.damping, D, L, B, basis)
        plain_B, plain_L = prioritised(it.sizes, it.J, it.weights, it.damping)
        largest = np.abs(plain_B).max()
        close(B.T, plain_B, largest, it)
        close(L / D[:, None] * D, plain_L / D[:, None] * D, 1 + largest * np.abs(it.J).max(), it)
        assert rank == np.linalg.matrix_rank(it.J, tol=1e-9 * np.abs(it.J).max())


@pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)
def test_the_certificate_is_the_schur_complement_and_its_eigenvalue(seeds):
    for seed in seeds:
        it = stack(seed)
        _, L = prioritised(it.sizes, it.J, it.weights, it.damping)
        C, V = np.zeros_like(L), np.zeros_like(L)
        lmi_kernels.stability_matrix(L, L.T @ L, it.wanted, 0.3, it.dt, C, V)
        expected = stability_matrix(L, it.wanted, 0.3, it.dt)
        largest = np.abs(expected).max()
        np.testing.assert_allclose(C, expected, rtol=0, atol=1e-10 * largest)
        least = lmi_kernels.least_eigenvalue(C, np.nan, 0.0, np.zeros((3, len(L))))
        assert least == pytest.approx(np.linalg.eigvalsh(expected)[0], abs=1e-10 * largest)


@pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)
def test_speeds_gains_and_beta_are_the_law_s(seeds):
    for seed in seeds:
        it = stack(seed)
        solver = ConstantGains(it.sizes, it.J.shape[1], it.wanted)
        solver.weights[:], solver.damping = it.weights, it.damping
        solver.lower[:], solver.upper[:], solver.rates[:] = it.lower, it.upper, it.rates
        assert solver.solve(it.J, it.errors, it.dt) == status.OK
        B, L = prioritised(it.sizes, it.J, it.weights, it.damping)
        D = np.sqrt(it.weights)
        limits, far = (it.lower, it.upper), np.full((2, it.J.shape[1]), np.inf) * [[-1], [1]]
        plain_L = L / D[:, None] * D
        fed, share = feed_forward(B, plain_L, it.rates, *limits, it.damping)
        free, _ = feed_forward(B, plain_L, it.rates, *far, it.damping)
        dq, gains = constant_gains(B, it.wanted, it.errors, fed, *limits)
        size = np.abs(fed).max() + np.abs(B @ (it.wanted * it.errors)).max()
        close(solver.fed, fed, size, it)
        way = np.abs(free - B @ it.rates).max()  # what only a share of is fed
        if way > 1e-4 * size:
            close(solver.fed_share, share, size / way, it)
        close(solver.dq, dq, size, it)
        close(solver.gains, gains, it.wanted.max(), it)
        beta = certified(L, gains, it.dt)
        scale = np.linalg.norm(L, 2) * gains.max()
        within = max(1e-10, 1e-15 * it.condition**2) * (scale + it.dt * scale**2)
        assert solver.beta == pytest.approx(beta, abs=ACCURACY * abs(beta) + within + 1e-200)
