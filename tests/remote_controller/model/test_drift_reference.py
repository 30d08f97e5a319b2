"""What frames and the centre of mass accelerate by where no joint does, by 4 × 4 matrices.

The rule: 1e-10, relative to 1 + the largest entry: nothing is inverted but poses.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.amounts import AMOUNTS, seed_ranges
from test_model_reference import near, rotation

from hoap3.remote_controller.model import drift_kernels, drift_reference

SEEDS = seed_ranges(1000, 1800, 6000)
many = pytest.mark.parametrize("seeds", SEEDS, ids=AMOUNTS)


def placed(rng: np.random.Generator) -> np.ndarray:
    """A pose (4, 4)."""
    return np.block([[rotation(rng), rng.normal(size=(3, 1))], [0.0, 0.0, 0.0, 1.0]])


def parts(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origin and rotation, as kernels take them."""
    return pose[:3, 3].copy(), pose[:3, :3].copy()


@many
def test_a_frame_seen_from_another_one(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 12))
        joints, dq = rng.normal(size=(6, n)), rng.normal(size=n)
        shared = np.arange(n) < rng.integers(n + 1)  # in a tree those that move both come first
        one, side = rng.random((2, n)) < 0.6
        moved, carried = one & (shared | side), one & (shared | ~side)
        pose, other, found = placed(rng), placed(rng), np.full(6, np.nan)
        origin, _ = parts(pose)
        _, S = parts(other)
        drift_kernels.frame_drift(joints, dq, origin, moved, S, carried, found)
        near(found, drift_reference.frame_drift(joints, dq, pose, moved, other, carried))


@many
def test_the_centre_of_mass_seen_from_a_frame(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 12))
        joints, dq, carried = rng.normal(size=(6, n)), rng.normal(size=n), rng.random(n) < 0.6
        com, other, found = rng.normal(size=(3, 3)), placed(rng), np.full(3, np.nan)
        drift_kernels.com_drift(joints, dq, *com, parts(other)[1], carried, found)
        near(found, drift_reference.com_drift(joints, dq, *com, other, carried))
