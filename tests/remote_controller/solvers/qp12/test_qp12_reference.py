"""QP12 within bounds and the pseudo-inverse against their plain references."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from support.amounts import seed_ranges
from support.oracles import qp12_oracle as reference
from support.solvers.one_shot import BoundedQp12

from hoap3.protocol.errors import InfeasibleError
from hoap3.remote_controller.solvers import Pinv

SEEDS = seed_ranges(250, 1050, 5250)
GAMMAS = (0.0, 0.1, 0.5, 0.9, 0.99, 1 - 1e-9, 1.0)


def fractions(values: np.ndarray) -> list[Fraction]:
    return [Fraction(value) for value in values]


@pytest.mark.parametrize("seeds", SEEDS)
def test_bounded_qp12_is_exact(seeds):
    """To 1e-10 of the largest speed, for every γ: the reference is in fractions, so without κ.

    Some gradients have ties or zeros, some bounds are 0 or infinite, some ask for too much.
    """
    refused = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, gamma = int(rng.choice([1, 2, 3, 7, 12])), GAMMAS[seed % len(GAMMAS)]
        gradient = rng.normal(size=n) * (rng.random(n) < 0.9)
        if rng.random() < 0.3:
            gradient = np.round(2.0 * gradient) / 2.0
        weights = np.ones(n) if rng.random() < 0.5 else rng.uniform(0.3, 3.0, n)
        lower, upper = -rng.uniform(0.01, 1.0, (2, n)) * (rng.random((2, n)) < 0.9)
        upper = np.where(rng.random(n) < 0.1, np.inf, -upper)
        most = float(np.sum(np.abs(gradient) * np.minimum(np.maximum(upper, -lower), 1.0)))
        decrease = float(rng.uniform(0.0, 1.2) * most * rng.choice([-1.0, 1.0]))
        exact = reference.bounded_qp12(
            fractions(gradient),
            Fraction(decrease),
            Fraction(gamma),
            [-math.inf if x == -math.inf else Fraction(x) for x in lower],
            [math.inf if x == math.inf else Fraction(x) for x in upper],
            fractions(weights),
        )
        solver, u = BoundedQp12(n, weights), np.zeros(n)
        if exact is None:
            refused += 1
            with pytest.raises(InfeasibleError):
                solver.solve(gradient, decrease, gamma, lower, upper, u)
            continue
        solver.solve(gradient, decrease, gamma, lower, upper, u)
        expected = np.array([float(x) for x in exact])
        np.testing.assert_allclose(u, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    assert 0.1 < refused / len(seeds) < 0.6


@pytest.mark.parametrize("seeds", SEEDS)
def test_pinv_is_the_pseudo_inverse(seeds):
    """To 1e-10 of the largest speed where κ(J) ≤ 1e4, to κ·1e-14 beyond that."""
    for seed in seeds:
        rng = np.random.default_rng(seed)
        m, n = int(rng.integers(1, 7)), int(rng.integers(1, 22))
        jacobian, error = rng.normal(size=(m, n)), rng.normal(size=m)
        jacobian *= 10.0 ** rng.uniform(-2.0, 2.0, (m, 1))
        if m > 1 and rng.random() < 0.2:
            jacobian[-1] = jacobian[0]  # rank m − 1 at the most
        values = np.linalg.svd(jacobian, compute_uv=False)
        rounding = max(1e-10, 1e-14 * values[0] / values[values > 1e-12 * values[0]][-1])
        decrease, solver, u = float(rng.normal()), Pinv(m, n), np.zeros(n)
        for solve, asked, expected in (
            (solver.solve, decrease, reference.pinv(jacobian, error, decrease)),
            (solver.solve_plain, decrease, reference.pinv_plain(jacobian, error, decrease)),
        ):
            solve(jacobian, error, asked, u)
            scale = np.abs(expected).max()
            np.testing.assert_allclose(u, expected, rtol=0, atol=rounding * scale)
