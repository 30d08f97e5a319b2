"""The gains against their optimum in plain numpy.

The rule, with κ the condition of L: where Newton's method ends, λ is within 1e-10 of the reference,
relative to 1 + |λ|, while κ ≤ 300, and within 1e-15 κ² beyond, or ten times as much where Z has
more than one column; β is within 1e-10 of β̃. Where the interior-point method alone has the answer
(its rank is 0), both are within 1e-8.
"""

from __future__ import annotations

import numpy as np
import pytest
from sdp_problems import optimum, small
from support.amounts import AMOUNTS, seed_ranges

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.clik.clik_reference import stability_matrix
from hoap3.remote_controller.solvers.sdp.sdp_reference import inequality


def test_the_schur_complement_of_21_is_c():
    rng = np.random.default_rng(0)
    for n in range(1, 8):
        L, x, dt = rng.normal(size=(n, n)), rng.normal(size=n + 1), rng.uniform(0.01, 1.0)
        whole = inequality(L, x, dt)
        inner, beside, outer = whole[:n, :n], whole[:n, n:], whole[n:, n:]
        complement = inner - beside @ np.linalg.solve(outer, beside.T)
        np.testing.assert_allclose(complement, stability_matrix(L, x[:n], x[n], dt), atol=1e-12)


@pytest.mark.parametrize(
    "seeds",
    seed_ranges(150, 950, 5150),
    ids=AMOUNTS,
)
def test_gains_are_the_optimum(seeds):
    known = 0
    for seed in seeds:
        it = small(seed)
        gains, beta, proved = optimum(it)
        solver = it.solved()
        if not proved or solver.status != status.OK:
            continue
        known += 1
        within = max(1e-10, 1e-15 * np.linalg.cond(it.matrices()[0]) ** 2)
        if solver.rank != 1:
            within = 10.0 * within if solver.rank else max(within, 1e-8)
        size = 1.0 + np.abs(gains).max()
        np.testing.assert_allclose(solver.gains, gains, rtol=0, atol=within * size)
        assert solver.beta == pytest.approx(beta, abs=(1e-10 if solver.rank else 1e-8) * it.desired)
    assert known > 0.75 * len(seeds)
