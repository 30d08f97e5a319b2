"""Facets of a sole's cone against its edges, by non-negative least squares."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.contact.wrench_cone import (
    cone_edges,
    wrench_cone,
    wrench_units,
)

RECTANGLE = [[0.054, 0.0365], [-0.054, 0.0365], [-0.054, -0.0365], [0.054, -0.0365]]
OUTLINES = {
    "rectangle": RECTANGLE,
    "triangle": [[0.1, 0.0], [-0.05, 0.06], [-0.05, -0.02]],
    "pentagon": [[0.06, 0.0], [0.03, 0.03], [-0.05, 0.04], [-0.05, -0.03], [0.03, -0.03]],
    "beside its frame": [[0.3, 0.2], [0.2, 0.2], [0.2, 0.1], [0.3, 0.1]],
}


def distance(outline: list[list[float]], friction: float, wrench: np.ndarray) -> float:
    """From the cone, in its units: what no sum of forces in the pyramids gives."""
    units = wrench_units(outline)
    return float(nnls((cone_edges(outline, friction) / units).T, wrench / units)[1])


@pytest.mark.parametrize("outline", OUTLINES.values(), ids=OUTLINES)
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), friction=st.sampled_from([0.1, 0.5, 1.0]))
def test_facets_hold_exactly_where_forces_at_the_corners_add_up(outline, seed, friction):
    random = np.random.default_rng(seed)
    edges, units = cone_edges(outline, friction), wrench_units(outline)
    inside = random.dirichlet(np.full(len(edges), 0.3)) @ edges
    facets = wrench_cone(outline, friction)
    assert (facets @ inside).max() <= 1e-9
    wrench = inside + random.normal(size=6) * units * random.choice([1e-3, 0.1, 1.0])
    away = distance(outline, friction, wrench)
    beyond = float((facets @ wrench).max())  # facets are of unit length: no farther than that
    assert beyond <= away + 1e-9
    assert (beyond > 1e-9) == (away > 1e-9)


def test_each_force_of_the_pyramids_is_within_the_friction_cone():
    for force in cone_edges(RECTANGLE, 0.6)[:, :3]:
        assert np.hypot(force[0], force[1]) <= 0.6 * force[2] * (1 + 1e-12)


def test_a_rectangle_has_the_sixteen_facets_of_its_closed_form():
    X, Y, mu = 0.054, 0.0365, 0.5
    rows = wrench_cone(RECTANGLE, np.sqrt(2.0) * mu)
    assert len(rows) == 16
    random = np.random.default_rng(3)
    for _ in range(300):
        fx, fy = random.uniform(-1.2, 1.2, 2) * mu
        tx, ty = random.uniform(-1.2, 1.2, 2) * [Y, X]
        tz = random.uniform(-1.2, 1.2) * mu * (X + Y)
        # Caron, Pham and Nakamura (ICRA 2015), of a unit normal force
        most = mu * (X + Y) - abs(Y * fx + mu * tx) - abs(X * fy + mu * ty)
        least = -mu * (X + Y) + abs(Y * fx - mu * tx) + abs(X * fy - mu * ty)
        slides = abs(fx) > mu or abs(fy) > mu or abs(tx) > Y or abs(ty) > X
        kept = not slides and least <= tz <= most
        assert kept == ((rows @ [fx, fy, 1.0, tx, ty, tz]).max() <= 1e-12)


@pytest.mark.parametrize(
    ("outline", "friction"),
    [
        ([[0.0, 0.0], [1.0, 0.0]], 0.5),
        ([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], 0.5),
        (RECTANGLE, 0.0),
        (RECTANGLE, float("nan")),
    ],
)
def test_what_is_no_sole_is_refused(outline, friction):
    with pytest.raises(BadProblemError):
        wrench_cone(outline, friction)
