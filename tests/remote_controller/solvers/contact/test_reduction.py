"""The unknowns that contacts leave, against the equations that they come from."""

import numpy as np
import pytest

from hoap3.remote_controller.solvers.contact.reduction import BASE, ContactReduction

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
