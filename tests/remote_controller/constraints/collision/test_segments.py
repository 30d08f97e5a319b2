"""A segment and a box: where it is nearest, how deep it is inside, and where it reaches a level."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hoap3.protocol.runtime.numba_jit import kernel
from hoap3.remote_controller.constraints.collision import segment_box_kernels as segments

SEEDS = st.integers(0, 2**32 - 1)


@kernel("Tuple((f8, f8, f8, f8, f8))(f8[::1], f8[::1], f8[::1], f8)", allocates=True)
def probe(a0, d, half, level):
    """The nearest s, both ends of the level, and the distance and depth there."""
    normal = np.empty(3)
    s = segments.nearest(a0, d, half)
    first = segments.edge(a0, d, half, s, 0.0, level)
    second = segments.edge(a0, d, half, s, 1.0, level)
    distance, _ = segments.witness(a0, d, half, s, normal)
    return s, first, second, segments.squared(a0, d, half, s), distance


def case(seed):
    """A segment and a box; some coordinates are 0 or on a face."""
    rng = np.random.default_rng(seed)
    half = rng.uniform(0.0, 0.3, 3) * rng.integers(0, 2, 3)
    ends = rng.uniform(-0.5, 0.5, (2, 3))
    if rng.random() < 0.3:
        ends[:, rng.integers(3)] = half[rng.integers(3)]
    if rng.random() < 0.2:
        ends[1] = ends[0]
    return ends[0], ends[1] - ends[0], half


def sampled(a0, d, half):
    s = np.linspace(0.0, 1.0, 2001)
    out = np.abs(a0 + s[:, None] * d) - half
    return s, (np.maximum(out, 0.0) ** 2).sum(axis=1), -out.max(axis=1)


@settings(max_examples=300)
@given(seed=SEEDS, spread=st.sampled_from([0.0, 1e-300, 1e-12, 1e-6, 5e-4, 0.1]))
def test_ends_of_a_level_are_finite_and_enclose_what_is_below_it(seed, spread):
    a0, d, half = case(seed)
    s, *_, least, _ = probe(a0, d, half, 0.0)
    level = (np.sqrt(least) + spread) ** 2
    inner, first, second, _, _ = probe(a0, d, half, level)
    assert 0.0 <= first <= inner <= second <= 1.0
    assert inner == s
    places, squares, _ = sampled(a0, d, half)
    below = places[squares < level * (1 - 1e-9) - 1e-18]
    assert ((first - 1e-6 <= below) & (below <= second + 1e-6)).all()
    for end in (first, second):
        out = np.maximum(np.abs(a0 + end * d) - half, 0.0)
        assert out @ out <= level + 1e-9


def test_an_end_that_is_the_nearest_point_is_the_end_of_every_level():
    a0, d, half = np.array([0.5, 0.0, 0.0]), np.array([0.3, 0.0, 0.0]), np.full(3, 0.1)
    for level in (0.0, 0.16 * (1.0 - 1e-16), np.nextafter(0.16, 0.0)):
        assert probe(a0, d, half, level)[:2] == (0.0, 0.0)
