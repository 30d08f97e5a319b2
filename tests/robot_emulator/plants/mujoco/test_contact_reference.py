"""The compiled wrenches of contacts against a few lines of numpy."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.robot_emulator.plants.mujoco.contact_kernels import feel
from hoap3.robot_emulator.plants.mujoco.contact_reference import felt


@pytest.mark.parametrize(
    "problems", [200, pytest.param(5_200, marks=pytest.mark.slow)], ids=["some", "all"]
)
def test_wrenches_are_moved_and_turned_into_each_frame(problems: int):
    """Within 1e-10 of 1 + the largest entry."""
    random = np.random.default_rng(7)
    for _ in range(problems):
        b, k = random.integers(1, 6, 2)
        forces, about = random.normal(size=(b, 6)) * 100.0, random.normal(size=(b, 3))
        mask, places = random.random((k, b)) < 0.5, random.normal(size=(k, 3))
        axes = np.linalg.qr(random.normal(size=(k, 3, 3)))[0]
        before = random.normal(size=6 * k)
        found, share = before.copy(), random.random()
        feel(forces, about, mask, places, axes.reshape(k, 9), share, found)
        expected = before.reshape(k, 6)
        for row in range(k):
            for body in np.flatnonzero(mask[row]):
                torque, force = forces[body, :3], forces[body, 3:]
                expected[row] += share * felt(torque, force, about[body], places[row], axes[row])
        np.testing.assert_allclose(
            found, expected.ravel(), rtol=0, atol=1e-10 * (1.0 + np.abs(expected).max())
        )
