"""Distances of `hoap3 verify`: closed forms against the hulls of corners."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hoap3.remote_controller.constraints.collision.distance_reference import closest, corners
from hoap3.remote_controller.problems.oracles.constraints import segments_oracle as segments
from hoap3.remote_controller.problems.oracles.constraints.contacts_oracle import Scene

SPREAD = 5e-4


def scene(rng: np.random.Generator, kinds: tuple[int, int]) -> Scene:
    """Two bodies; of the extents of each so many are not 0, the last ones."""
    half = rng.uniform(0.01, 0.08, (2, 3))
    for body, kind in enumerate(kinds):
        half[body, : 3 - kind] = 0.0
    middles = np.vstack([np.zeros(3), rng.normal(0.0, 0.12, 3)])
    turns = Rotation.random(2, random_state=rng).as_matrix()
    which = np.array([[0, 1]])
    return Scene(middles, turns, half, which, np.array([min(kinds) > 1]))


@pytest.mark.parametrize("kinds", [(0, 3), (1, 1), (1, 3), (3, 3)])
def test_a_pair_is_as_far_apart_as_its_hulls(kinds: tuple[int, int]) -> None:
    rng = np.random.default_rng(sum(kinds))
    for _ in range(40):
        bodies = scene(rng, kinds)
        hulls = [
            corners(*place) for place in zip(bodies.middles, bodies.turns, bodies.half, strict=True)
        ]
        first, second = closest(*hulls)
        apart = float(np.linalg.norm(first - second))
        if apart < 1e-3:
            continue

        found = bodies.segments(np.array([0]), SPREAD)

        assert found.distance.min() == pytest.approx(apart, abs=1e-9)
        assert bodies.at_least(np.array([0]))[0] <= apart + 1e-12


def test_rows_stand_where_a_pair_is_nearest_and_point_from_one_to_the_other() -> None:
    rng = np.random.default_rng(7)
    for _ in range(40):
        bodies = scene(rng, (1, 3))
        found = bodies.segments(np.array([0]), SPREAD)
        least = float(found.distance.min())
        if least < 1e-3:
            continue

        points = bodies.points(found, np.array([least + SPREAD]), SPREAD, np.array([True]))

        assert points.asked.all()
        assert points.distance.min() == pytest.approx(least, abs=1e-12)
        assert (points.distance <= least + SPREAD + 1e-9).all()
        nearest = int(points.distance.argmin())
        step = 1e-6 * points.normal[nearest]
        moved = replace(bodies, middles=bodies.middles + np.array([step, np.zeros(3)]))
        further = moved.segments(np.array([0]), SPREAD).distance.min()
        assert further - least == pytest.approx(1e-6, rel=1e-3)


def test_the_end_of_what_is_nearly_as_near_is_found() -> None:
    rng = np.random.default_rng(3)
    a, half = rng.uniform(-0.3, 0.3, (50, 3)), rng.uniform(0.01, 0.1, (50, 3))
    d = rng.uniform(-0.3, 0.3, (50, 3))
    s = segments.nearest(a, d, half)
    least, _ = segments.distance(a, d, half, s)
    level = np.maximum(least, 0.0) + 0.01

    end = segments.furthest(a, d, half, s, np.ones(50), level)

    there, _ = segments.distance(a, d, half, end)
    beyond, _ = segments.distance(a, d, half, np.minimum(end + 1e-6, 1.0))
    assert (there <= level + 1e-12).all()
    assert ((end == 1.0) | (beyond > level)).all()
