"""Curves of chunks against plain numpy, relative to 1 + the largest entry, in units of a step."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.remote_controller.references.live import live_kernels as kernels
from hoap3.remote_controller.references.live import live_reference as reference


def assert_near(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * (1 + np.abs(expected).max()))


@pytest.mark.parametrize("problems", [300, pytest.param(5000, marks=pytest.mark.long)])
def test_nodes_and_curves_are_those_of_the_equations(problems):
    rng = np.random.default_rng(0)
    for _ in range(problems):
        count, d = int(rng.integers(2, 12)), int(rng.integers(1, 33))
        step = float(10.0 ** rng.uniform(-3, 1))
        points, rates = rng.standard_normal((2, count, d)) * 10.0 ** rng.uniform(-3, 3)
        speeds, bends = np.zeros((2, count, d))
        kernels.spline_nodes(step, points, speeds, bends)
        expected = reference.spline_nodes(step, points)
        assert_near(step * speeds, step * expected[0])
        assert_near(step**2 * bends, step**2 * expected[1])
        kernels.difference_nodes(step, rates, bends)
        assert_near(bends * step, reference.difference_nodes(step, rates) * step)
        nodes, out = np.hstack([points, rates, bends]), np.zeros((4, d))
        elapsed = float(rng.uniform(-0.1, 1.1)) * step * (count - 1)
        kernels.curve_at(elapsed, step, nodes, d, out)
        for k, row in enumerate(reference.curve_at(elapsed, step, nodes, d)):
            scale = 1 + np.abs(nodes).max() * max(1.0, step**2)
            np.testing.assert_allclose(out[k] * step**k, row * step**k, rtol=0, atol=1e-9 * scale)


@pytest.mark.slow
def test_extremes_are_the_greatest_of_many_looks():
    rng = np.random.default_rng(1)
    for _ in range(10):
        count, d, step = (
            int(rng.integers(2, 9)),
            int(rng.integers(1, 5)),
            float(rng.uniform(0.01, 1)),
        )
        nodes, begin = rng.standard_normal((count, 3 * d)), float(rng.uniform(0, step))
        found = np.zeros((3, d))
        kernels.extremes(begin, step, nodes, d, -1, np.zeros((4, d)), found)
        first = int(begin / step * kernels.LOOKS)
        looks = step / kernels.LOOKS * np.arange(first, (count - 1) * kernels.LOOKS + 1)
        curves = np.array([reference.curve_at(time_s, step, nodes, d) for time_s in looks])
        np.testing.assert_allclose(found, np.abs(curves[:, 1:]).max(0), rtol=1e-6)
