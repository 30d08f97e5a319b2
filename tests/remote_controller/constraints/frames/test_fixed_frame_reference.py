"""Rows that keep a frame still against plain numpy.

The rule: 1e-10 of the largest of what is added up.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.amounts import AMOUNTS, seed_ranges

from hoap3.remote_controller.constraints.frames import fixed_frame_reference as plain
from hoap3.remote_controller.constraints.frames.fixed_frame_kernels import kept_rows

SEEDS = seed_ranges(1000, 1800, 6000)


@pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)
def test_rows_are_the_slope_of_the_displacement(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n, rate = int(rng.integers(1, 12)), 10.0 ** rng.uniform(-2, 2)
        axes = rng.permutation(6)[: rng.integers(1, 7)]
        (p, p_kept), jacobian = rng.normal(size=(2, 3)), rng.normal(size=(6, n))
        R, R_kept = Rotation.random(2, rng=rng).as_matrix()
        A, b = np.empty((len(axes), n)), np.empty(len(axes))
        worst = kept_rows(p, R, p_kept, R_kept, jacobian, axes, rate, A, b)
        e = plain.displacement(p, R, p_kept, R_kept)[axes]
        np.testing.assert_allclose(A, plain.slope(R, R_kept, jacobian)[axes], rtol=0, atol=1e-10)
        np.testing.assert_allclose(b, -rate * e, rtol=0, atol=1e-10 * (1.0 + rate))
        assert worst == pytest.approx(np.abs(e).max(), rel=1e-10, abs=1e-10)
