"""The logarithm of a pose error against those of matrices.

The rule: 1e-10, relative to 1 + the largest entry, up to 3 rad; nearer to half a turn, where the
logarithm of a matrix is ill-conditioned, 1e-10/(π − θ)², θ the angle of the error.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from support.amounts import AMOUNTS, seed_ranges

from hoap3.remote_controller.tasks import se3_kernels, se3_reference

SEEDS = seed_ranges(150, 1050, 5650)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)
def test_error_jacobian_and_rate_are_those_of_the_matrix_logarithm(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        away = rng.normal(size=3)
        away *= rng.choice([1e-9, 1e-3, rng.uniform(0, 0.4), rng.uniform(0, 3.1)])
        away *= min(1.0, 3.1 / np.linalg.norm(away))
        target, target_rate = rng.normal(size=6), rng.normal(size=6)
        turned = expm(se3_reference.cross_matrix(target[3:]))
        rotation = turned @ expm(se3_reference.cross_matrix(away))
        position, twists = rng.normal(size=3), rng.normal(size=(6, 2))
        error, jacobian, rate = np.zeros(6), np.zeros((6, 2)), np.zeros(6)
        work = np.zeros((2, 3, 3))
        se3_kernels.pose_error(
            position, rotation, twists, target, target_rate, work, error, jacobian, rate
        )
        expected = se3_reference.pose_error(position, rotation, twists, target, target_rate)
        angle = min(np.linalg.norm(away), np.pi)
        within = 1e-10 * max(1.0, 0.02 / (np.pi - angle) ** 2)
        for found, wanted in zip((error, jacobian, rate), expected, strict=True):
            size = 1.0 + np.abs(wanted).max()
            np.testing.assert_allclose(found, wanted, rtol=0, atol=within * size)
        near, out = 4.0 * rng.normal(size=3), np.zeros(3)
        se3_kernels.rotation_vector(rotation, near, out)
        wanted = se3_reference.rotation_vector(rotation, near)
        left = np.pi - abs(np.pi - np.linalg.norm(wanted))  # of the shorter way round
        within = 1e-10 * max(1.0, 0.02 / max(np.pi - left, 1e-3) ** 2)
        np.testing.assert_allclose(out, wanted, rtol=0, atol=within * 10.0)
