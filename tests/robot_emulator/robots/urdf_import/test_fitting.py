"""The tightest box, capsule or sphere: it contains every vertex, and is no larger than it must."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.urdfs.vendor_arm import tube

from hoap3.robot_emulator.robots.urdf_import.fitting import (
    LEAST_M,
    SPARE_M,
    Shape,
    enclosing_ball,
    tightest,
)


def outside(shape: Shape, points: np.ndarray) -> float:
    """How far the farthest point is outside [m]; negative if all are inside."""
    inside = (points - shape.center) @ shape.axes
    if shape.kind == "box":
        return float((np.abs(inside) - np.array(shape.size) / 2).max())
    radius, length = (*shape.size, 0.0)[:2]
    inside[:, 2] -= np.clip(inside[:, 2], -length / 2, length / 2)
    return float(np.linalg.norm(inside, axis=1).max() - radius)


def turned(points: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return Rotation.random(random_state=seed).apply(points) + rng.uniform(-1, 1, 3)


def ball(count: int, radius: float) -> np.ndarray:
    rng = np.random.default_rng(count)
    points = rng.normal(size=(count, 3))
    return radius * points / np.linalg.norm(points, axis=1)[:, None]


BOX = np.array(np.meshgrid([0, 0.3], [0, 0.2], [0, 0.07])).reshape(3, -1).T


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("points", "kind", "size"),
    [
        (BOX, "box", (0.07, 0.2, 0.3)),
        (tube(0.05, 0.4), "capsule", (0.05, 0.4)),
        (ball(2000, 0.2), "sphere", (0.2,)),
    ],
    ids=["box", "capsule", "sphere"],
)
def test_what_is_a_shape_already_is_found_however_it_is_turned(points, kind, size, seed):
    points = turned(points, seed)
    shape = tightest(points)
    assert shape.kind == kind
    found = sorted(shape.size) if kind == "box" else shape.size
    np.testing.assert_allclose(found, size, rtol=5e-3, atol=3 * SPARE_M)
    assert outside(shape, points) <= 0.0


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 60),
    scales=st.tuples(*[st.sampled_from([0.0, 1e-4, 0.1, 3.0])] * 3),
)
def test_every_vertex_is_inside(seed, count, scales):
    rng = np.random.default_rng(seed)
    points = turned(rng.normal(size=(count, 3)) * scales, seed)
    shape = tightest(points)
    assert outside(shape, points) <= 0.0
    assert min(shape.size[:1]) >= LEAST_M
    extent = np.linalg.norm(np.ptp(points, axis=0)) + LEAST_M
    assert shape.volume <= (extent + 4 * SPARE_M + LEAST_M) ** 3  # the box along the axes at most


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 40), d=st.sampled_from([2, 3]))
def test_the_smallest_ball_is_that_of_its_own_surface(seed, count, d):
    points = np.random.default_rng(seed).normal(size=(count, d))
    center, radius = enclosing_ball(points)
    distances = np.linalg.norm(points - center, axis=1)
    assert distances.max() == pytest.approx(radius, rel=1e-14)
    # smallest: its centre is in the hull of the points on its surface, so that every way of
    # moving it takes it farther from one of them
    on_surface = points[distances >= radius * (1 - 1e-6)] - center
    directions = np.random.default_rng(0).normal(size=(200, d))
    assert ((on_surface @ directions.T).min(axis=0) <= 1e-6).all()
