"""`ghc`, `hqp` and `weighted` at single States: against other solvers, and what they promise."""

from __future__ import annotations

import gc
import tracemalloc

import numpy as np
import pytest
from hierarchy_runs import made, robot, state_of, states
from support.oracles.plain_lqp import lqp

from hoap3.protocol.errors import SolverError
from hoap3.remote_controller.controllers.acceleration.hqp import levels_of
from hoap3.remote_controller.controllers.acceleration.problem import CONDITIONS
from hoap3.remote_controller.controllers.base import STATUS

FREE = {"kind": "none", "torque_max": [1e4]}


def pieces(controller):
    tasks = controller.tasks
    return [tasks.jacobian[rows] for rows in tasks.rows], [
        tasks.wanted[rows] for rows in tasks.rows
    ]


@pytest.mark.parametrize("regularise", ["none", "torque", "gravity_compensated"])
@pytest.mark.parametrize("gravity", ["none", "full"])
@pytest.mark.parametrize("damping", [0.0, 10.0])
def test_ghc_is_the_plain_program_of_an_independent_solver(regularise, gravity, damping):
    """With a task that brakes below all, or without one."""
    description = robot("lwr_weightless", gravity=gravity)
    bounds = {"kind": "viability", "torque_max": [40.0]}
    alpha = np.array([[0.0, 0.3, 0.0], [0.7, 0.0, 0.0], [1.0, 1.0, 0.2]])
    whole = np.block([[alpha, np.zeros((3, 1))], [np.array([1.0, 1.0, 0.8, 0.0])]])
    controller = made(
        "ghc",
        description,
        regularise=regularise,
        bounds=bounds,
        priorities={"matrix": alpha.tolist()},
        w_r=1e-3,
        null_damping_per_s=damping,
    )
    compared = held = 0
    for state in states(controller, 40):
        controller.reset(state, None)
        command = controller.step(state)
        dynamics, limits = controller.tasks.dynamics, controller.bounds
        rows, wanted = pieces(controller)
        if damping:
            rows, wanted = [*rows, np.eye(7)], [*wanted, -damping * state.dq]
        priorities = whole if damping else alpha
        problem = rows, wanted, priorities, dynamics.mass, dynamics.bias, 1e-3
        try:
            ddq, tau = lqp(
                *problem,
                regularise=regularise,
                qdd_lower=limits.lower,
                qdd_upper=limits.upper,
                tau_lower=-controller.torque_max,
                tau_upper=controller.torque_max,
            )
        except SolverError:
            assert command.fallback > 0
            continue
        assert command.fallback == 0
        compared += 1
        held += controller.solver.active > 0
        size = max(1.0, np.abs(ddq).max())
        np.testing.assert_allclose(controller.ddq, ddq, rtol=0, atol=1e-6 * size)
        np.testing.assert_allclose(controller.tau, tau, rtol=0, atol=1e-6 * np.abs(tau).max())
        np.testing.assert_array_equal(command.values, controller.tau)
    assert compared >= 20
    assert held >= 10


def test_a_task_inserted_below_changes_nothing_for_those_above():
    above = {"order": ["hand", "elbow", "posture"]}
    changes = {"bounds": FREE, "regularise": "none"}
    without = made("ghc", priorities={**above, "inactive": ["elbow", "posture"]}, **changes)
    upper = made("ghc", priorities={**above, "inactive": ["posture"]}, **changes)
    whole = made("ghc", priorities=above, **changes)
    moved = 0.0
    for state in states(whole, 30):
        residuals, answers = [], []
        for controller in (without, upper, whole):
            controller.reset(state, None)
            controller.step(state)
            J, b = pieces(controller)
            residuals.append([J[i] @ controller.ddq - b[i] for i in (0, 1)])
            answers.append(controller.ddq.copy())
        size = max(1.0, np.abs(answers).max())
        for other in residuals[1:]:
            np.testing.assert_allclose(other[0], residuals[0][0], rtol=0, atol=1e-9 * size)
        np.testing.assert_allclose(residuals[2][1], residuals[1][1], rtol=0, atol=1e-9 * size)
        moved = max(moved, np.abs(answers[2] - answers[1]).max())
    assert moved > 1.0  # the posture did do something


def test_at_level_one_all_three_agree_where_nothing_is_regularised_but_a_little():
    order = {"order": ["hand", "elbow", "posture"]}
    ranked = {"bounds": FREE, "w_r": 1e-6, "priorities": order}
    weights = {"weights": {"hand": 100.0, "elbow": 1e-4, "posture": 1e-7}}
    three = (
        made("ghc", regularise="none", **ranked),
        made("hqp", **ranked),
        made("weighted", regularise="none", bounds=FREE, w_r=1e-6, priorities=weights),
    )
    for state in states(three[0], 10):
        for controller in three:
            controller.reset(state, None)
            controller.step(state)
            J, b = pieces(controller)
            if np.linalg.svd(J[0])[1][-1] > 0.05:
                size = max(1.0, np.abs(b[0]).max())
                assert np.abs(J[0] @ controller.ddq - b[0]).max() <= 1e-3 * size


def test_motors_that_are_too_weak_are_asked_for_as_little_as_possible_and_it_is_said():
    description = robot("lwr_weightless", gravity="full")
    controller = made("ghc", description, bounds={"acceleration_max": [5.0], "torque_max": [2.0]})
    state = state_of(controller, description.postures["bent"], np.zeros(7))
    command = controller.step(state)
    assert command.fallback == 2
    assert command.solver_status == STATUS["infeasible"]
    assert np.isfinite(command.values).all()
    lower, upper = controller.bounds.lower, controller.bounds.upper
    assert (lower <= controller.ddq).all()
    assert (controller.ddq <= upper).all()
    assert command.margin < 0.0
    said = [name for bit, name in enumerate(CONDITIONS) if controller.present >> bit & 1]
    assert {"torques too small", "cannot hold its load"} <= {*said}


def test_tasks_that_keep_each_other_out_altogether_leave_the_nearest_answer():
    """In a cycle nothing may move; a joint that is too fast must brake all the same."""
    cycle = {"matrix": [[1.0, 1.0, 1.0]] * 3}
    controller = made("ghc", priorities=cycle, regularise="none", null_damping_per_s=0.0)
    description = controller.description
    fast = np.zeros(7)
    q = description.initial_position.copy()
    q[3], fast[3] = description.upper[3] - 0.02, 0.9
    command = controller.step(state_of(controller, q, fast))
    assert controller.bounds.upper[3] < 0.0
    assert command.fallback == 1
    assert lies_within(controller)
    assert np.isfinite(command.values).all()


@pytest.mark.parametrize("name", ["ghc", "hqp", "weighted"])
def test_what_no_task_speaks_of_brakes(name):
    """Accelerations of 0 would keep a velocity."""
    speeds = 0.02 * np.arange(1.0, 8.0)
    for damping in (0.0, 10.0, 1e4):
        given = {"null_damping_per_s": damping, "w_r": 1e-6}
        if name != "hqp":
            given["regularise"] = "none"
        none = {"weights": dict.fromkeys(["hand", "elbow", "posture"], 0.0)}
        if name != "weighted":
            none = {"matrix": [[1.0] * 3] * 3}
        controller = made(name, priorities=none, bounds=FREE, **given)
        q = np.array(controller.description.postures["bent"])
        command = controller.step(state_of(controller, q, speeds))
        assert command.fallback == 0
        d = min(damping, 1.0 / controller.description.period_s)  # no faster than to rest at once
        np.testing.assert_allclose(controller.ddq, -d * speeds, atol=1e-3 * (1.0 + d))


def test_where_tasks_span_the_robot_there_is_nothing_to_brake():
    """The hierarchies of the paper's Table 1: the same to the last digit."""
    plain, braking = made("ghc", null_damping_per_s=0.0), made("ghc")
    for state in states(braking, 10):
        for each in (plain, braking):
            each.reset(state, None)
            each.step(state)
        np.testing.assert_array_equal(plain.tau, braking.tau)


def lies_within(controller) -> bool:
    bounds, room = controller.bounds, 1e-9
    return bool(
        (controller.ddq >= bounds.lower - room).all()
        and (controller.ddq <= bounds.upper + room).all()
        and (np.abs(controller.tau) <= controller.torque_max * (1 + room)).all()
    )


@pytest.mark.parametrize("name", ["ghc", "hqp", "weighted"])
def test_any_state_gets_numbers_within_bounds_or_is_said_to_have_none(name):
    controller = made(name)
    for state in states(controller, 60, seed=8, speed=1.0):
        controller.reset(state, None)
        command = controller.step(state)
        assert np.isfinite(command.values).all()
        assert lies_within(controller) or command.fallback >= 2


def test_where_no_task_takes_part_there_is_nothing_to_certify():
    """V of nobody is 0, which is no merit."""
    names = ["hand", "elbow", "posture"]
    for inactive, status in ((names[1:], "certified"), (names, "uncertified")):
        controller = made("ghc", priorities={"order": names, "inactive": inactive})
        q = np.array(controller.description.postures["bent"])
        command = controller.step(state_of(controller, q, np.zeros(q.size)))
        assert command.solver_status == STATUS[status]
        idle = bool(controller.present >> CONDITIONS.index("no task takes part") & 1)
        assert idle == (inactive == names)


def test_a_wrench_that_is_not_finite_is_refused():
    controller = made("ghc_force")
    state = states(controller, 1)[0]
    state.wrench[2] = np.inf
    command = controller.step(state)
    assert np.isnan(command.values).all()
    assert command.solver_status == STATUS["infeasible"]


@pytest.mark.parametrize("name", ["ghc", "hqp"])
def test_an_answer_that_overflows_is_not_blamed_on_the_state(name):
    controller = made(name)
    command = controller.step(state_of(controller, np.zeros(7), np.full(7, 1e160)))
    assert np.isnan(command.values).all()
    assert controller.present == 1 << CONDITIONS.index("answer not finite")


def test_a_robot_that_takes_accelerations_gets_them():
    controller = made("ghc", robot("lwr_weightless", command_kinds=("acceleration",)))
    state = states(controller, 1)[0]
    controller.reset(state, None)
    np.testing.assert_array_equal(controller.step(state).values, controller.ddq)


def test_weights_are_never_strict_and_monotone():
    errors = []
    for weight in (0.01, 1.0, 100.0):
        controller = made(
            "weighted",
            bounds=FREE,
            priorities={"weights": {"hand": weight, "elbow": 1.0, "posture": 1e-3}},
        )
        total = 0.0
        for state in states(controller, 10):
            controller.reset(state, None)
            controller.step(state)
            J, b = pieces(controller)
            total += float(np.linalg.norm(J[0] @ controller.ddq - b[0]))
        errors.append(total)
    assert errors[0] > errors[1] > errors[2] > 0.0


def test_levels_are_found_from_priorities():
    order = np.array([[0.0, 0.4, 0.0], [0.6, 0.0, 0.0], [1.0, 1.0, 0.0]])
    assert levels_of(order) == [[0], [1], [2]]
    removed = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.0, 0.0, 0.0]])
    assert levels_of(removed) == [[0], [2]]
    cycle = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    assert levels_of(cycle) == [[0, 1, 2]]
    above = np.array(
        [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0, 0, 1, 0]]
    )
    assert levels_of(above) == [[0, 1, 2], [3]]
    swapped = [3, 1, 0, 2]
    assert levels_of(above[np.ix_(swapped, swapped)]) == [[1, 2, 3], [0]]
    assert levels_of(np.block([[0.0, np.zeros(4)], [np.ones((4, 1)), above]])) == [
        [0],
        [1, 2, 3],
        [4],
    ]
    assert levels_of(np.ones((2, 2))) == []


@pytest.mark.parametrize("name", ["ghc", "ghc_humanoid"])
def test_the_hot_path_of_ghc_allocates_nothing_notable(name):
    controller = made(name)
    q = controller.description.initial_position
    state = state_of(controller, q, np.zeros(q.size))
    for tick in range(50):
        state.tick = tick
        controller.step(state)
    gc.collect()
    tracemalloc.start()
    try:
        for tick in range(50, 60):
            state.tick = tick
            controller.step(state)
        tracemalloc.reset_peak()
        before = tracemalloc.get_traced_memory()[0]
        state.tick = 60
        controller.step(state)
        peak = tracemalloc.get_traced_memory()[1] - before
    finally:
        tracemalloc.stop()
    inertia = controller.description.n**2 * 8  # which Pinocchio's crba gives away as a copy
    assert peak <= inertia + 1024  # views and numbers
