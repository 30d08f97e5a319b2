"""Contact of soles: the reduction of forces and the cone of wrenches."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from hoap3.protocol.errors import BadProblemError
from hoap3.remote_controller.solvers.contact.reduction import BASE, ContactReduction
from hoap3.remote_controller.solvers.contact.wrench_cone import (
    cone_edges,
    wrench_cone,
    wrench_units,
)

N = 9


def a_robot(seed: int, soles: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    square = random.normal(size=(N + BASE, N + BASE))
    mass, bias = square @ square.T + np.eye(N + BASE), random.normal(size=N + BASE)
    return mass, bias, random.normal(size=(6 * soles, N + BASE)), random.normal(size=6 * soles)


@pytest.mark.parametrize("soles", [0, 1, 2])
def test_every_y_moves_and_holds_the_robot_by_its_equations(soles):
    mass, bias, jacobian, wanted = a_robot(4, soles)
    found = ContactReduction(N, np.tile([10.0, 10.0, 10.0, 0.5, 0.5, 0.5], soles))
    assert found.update(mass, bias, jacobian, wanted)
    for y in np.random.default_rng(1).normal(size=(20, N)):
        v = found.motion_start + found.motion @ y
        w = found.wrench_start + found.wrench @ y
        tau = found.torque_start + found.torque @ y
        force = mass @ v + bias - jacobian.T @ w
        assert np.allclose(jacobian @ v, wanted, atol=1e-11)
        assert np.allclose(force, [*np.zeros(BASE), *tau], atol=1e-10)


def test_every_motion_that_the_equations_allow_has_a_y():
    mass, bias, jacobian, wanted = a_robot(5, 1)
    units = np.array([10.0, 10.0, 10.0, 0.5, 0.5, 0.5])
    found = ContactReduction(N, units)
    found.update(mass, bias, jacobian, wanted)
    random = np.random.default_rng(2)
    v, *_ = np.linalg.lstsq(jacobian, wanted)
    v += np.linalg.svd(jacobian)[2][6:].T @ random.normal(size=N)
    w = np.linalg.solve(jacobian[:, :BASE].T, mass[:BASE] @ v + bias[:BASE])
    Z = np.vstack([found.motion, found.wrench / units[:, None]])
    x = np.concatenate([v - found.motion_start, (w - found.wrench_start) / units])
    assert np.allclose(Z.T @ Z, np.eye(N), atol=1e-12)
    assert np.allclose(Z @ (Z.T @ x), x, atol=1e-10)


def test_soles_that_hold_each_other_are_refused_and_nothing_changes():
    mass, bias, jacobian, wanted = a_robot(6, 2)
    found = ContactReduction(N, np.ones(12))
    assert found.update(mass, bias, jacobian, wanted)
    before = found.torque.copy()
    jacobian[6:] = jacobian[:6]
    assert not found.update(mass, bias, jacobian, wanted)
    assert (found.torque == before).all()


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
