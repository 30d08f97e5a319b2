"""The approach against plain numpy, relative to 1 + the largest entry."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.remote_controller.references.approach_reference import approach
from hoap3.remote_controller.references.target import Approach, Target


class Passing(Target):
    """c + t·ċ."""

    def __init__(self, position, velocity):
        super().__init__(len(position))
        self.position, self.velocity = position, velocity

    def follow(self, elapsed_s, position_out, velocity_out):
        position_out[:] = self.position + elapsed_s * self.velocity
        velocity_out[:] = self.velocity


@pytest.mark.parametrize("problems", [300, pytest.param(5000, marks=pytest.mark.slow)])
def test_position_and_velocity_are_those_of_the_formula(problems):
    rng = np.random.default_rng(0)
    for _ in range(problems):
        m, duration = int(rng.integers(1, 33)), float(10.0 ** rng.uniform(-3, 2))
        start, position, velocity = rng.standard_normal((3, m)) * 10.0 ** rng.uniform(-3, 3)
        target, x, v = Approach(Passing(position, velocity), duration), np.zeros(m), np.zeros(m)
        target.start(start, 5.0)
        elapsed = float(rng.uniform(0.0, duration))
        target.follow(elapsed, x, v)
        where = position + elapsed * velocity
        for found, expected in zip(
            (x, v), approach(start, where, velocity, elapsed, duration), strict=True
        ):
            scale = 1.0 + np.abs(expected).max()
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10 * scale)
