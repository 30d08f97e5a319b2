"""`ghc_torque` at single States: against other solvers, and what strict priorities promise."""

from __future__ import annotations

import numpy as np
import pytest
from hierarchy_runs import made, robot, states
from support.oracles.plain_lqp import lqp, projected_sum

from hoap3.protocol.errors import SolverError
from hoap3.remote_controller.controllers.acceleration.torque_rows_kernels import torque_rows

FREE = {"kind": "none", "torque_max": [1e4]}
MIXED = np.array([[0.0, 0.3, 0.0], [0.7, 0.0, 0.0], [1.0, 1.0, 0.2]])


def through_inertia(controller, dq, damping):
    """J_i M⁻¹ of each task, and of the one that brakes; b_i; and the inverse of M; by numpy."""
    tasks, inverse = controller.tasks, np.linalg.inv(controller.tasks.dynamics.mass)
    rows = [tasks.jacobian[each] @ inverse for each in tasks.rows]
    return [*rows, inverse], [*(tasks.wanted[each] for each in tasks.rows), -damping * dq], inverse


@pytest.mark.parametrize("gravity", ["none", "full"])
def test_torques_are_those_of_the_tasks_projected_and_summed(gravity):
    controller = made(
        "ghc_torque",
        robot("lwr_weightless", gravity=gravity),
        bounds=FREE,
        priorities={"matrix": MIXED.tolist()},
        w_r=1e-3,
    )
    alpha = np.block([[MIXED, np.zeros((3, 1))], [np.array([1.0, 1.0, 0.8, 0.0])]])
    compared = 0
    for state in states(controller, 40):
        controller.reset(state, None)
        controller.step(state)
        rows, wanted, _ = through_inertia(controller, state.dq, 10.0)
        own = [
            J.T @ np.linalg.solve(J @ J.T + 1e-3 * np.eye(len(J)), b)
            for J, b in zip(rows, wanted, strict=True)
        ]
        dynamics = controller.tasks.dynamics
        tau = dynamics.bias + projected_sum(own, rows, alpha)
        if (np.abs(tau) >= controller.torque_max).any():
            continue  # no more than the robot has
        compared += 1
        np.testing.assert_allclose(controller.tau, tau, rtol=0, atol=1e-6 * np.abs(tau).max())
        ddq = np.linalg.solve(dynamics.mass, tau - dynamics.bias)
        np.testing.assert_allclose(controller.ddq, ddq, rtol=0, atol=1e-6 * np.abs(ddq).max())
    assert compared >= 20


def test_within_bounds_it_is_the_program_of_an_independent_solver():
    bounds = {"kind": "viability", "torque_max": [40.0]}
    controller = made(
        "ghc_torque",
        robot("lwr_weightless", gravity="full"),
        bounds=bounds,
        priorities={"matrix": MIXED.tolist()},
        null_damping_per_s=0.0,
        w_r=1e-3,
    )
    compared = held = 0
    for state in states(controller, 40):
        controller.reset(state, None)
        command = controller.step(state)
        bias, limits = controller.tasks.dynamics.bias, controller.bounds
        rows, wanted, inverse = through_inertia(controller, state.dq, 0.0)
        try:
            torque, ddq = lqp(
                rows[:-1],
                wanted[:-1],
                MIXED,
                inverse,
                np.zeros(7),
                1e-3,
                regularise="none",
                qdd_lower=-controller.torque_max - bias,
                qdd_upper=controller.torque_max - bias,
                tau_lower=limits.lower,
                tau_upper=limits.upper,
            )
        except SolverError:
            assert command.fallback > 0
            continue
        compared += 1
        held += controller.solver.active > 0
        tau = torque + bias
        np.testing.assert_allclose(controller.ddq, ddq, rtol=0, atol=1e-5 * np.abs(ddq).max())
        np.testing.assert_allclose(controller.tau, tau, rtol=0, atol=1e-5 * np.abs(tau).max())
        assert controller.residual <= 1e-9
    assert compared >= 20
    assert held >= 10


def test_lower_tasks_do_not_accelerate_what_is_strictly_above_them():
    order = {"order": ["hand", "elbow", "posture"]}
    alone = made("ghc_torque", bounds=FREE, priorities={**order, "inactive": ["elbow", "posture"]})
    whole = made("ghc_torque", bounds=FREE, priorities=order)
    compared = 0
    for state in states(whole, 40):
        found = []
        for controller in (alone, whole):
            controller.reset(state, None)
            controller.step(state)
            hand = controller.tasks.jacobian[controller.tasks.rows[0]]
            found.append((hand @ controller.ddq, controller.ddq.copy()))
        if alone.solver.active or whole.solver.active:
            continue  # at a limit of the robot all have to give way
        compared += 1
        size = max(1.0, np.abs(found[1][1]).max())
        np.testing.assert_allclose(found[1][0], found[0][0], rtol=0, atol=1e-9 * size)
        assert np.abs(found[1][1] - found[0][1]).max() > 1e-3
    assert compared >= 20


def test_rows_of_torques_are_the_solutions_of_m_x_is_j():
    rng = np.random.default_rng(0)
    for n in range(1, 13):
        for _ in range(420):
            root = rng.normal(size=(n, n))
            M, J = root @ root.T + 0.1 * np.eye(n), rng.normal(size=(n + 3, n))
            out, factor = np.zeros_like(J), np.zeros_like(M)
            assert torque_rows(J, M, factor, out)
            expected = np.linalg.solve(M, J.T).T
            np.testing.assert_allclose(out, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    assert not torque_rows(J, -M, factor, out)
