"""What every controller must do, whoever wrote it.

The suite runs over the shipped configs. To run it over your own controller, unedited:

    HOAP3_TEST_CONTROLLERS="mypackage.mymodule:MyController,other.yaml" \\
        python -m pytest tests/remote_controller/controllers/test_controller_properties.py

A bare class is built with its default parameters, a file with those that it names, for the robot
that it names. With `HOAP3_TEST_ROBOT=path/to/robot.yaml` they move another one. The hand-over is
tried between all that are named and whose setpoints are positions, so add `qp12` to see yours
taking over from it.
"""

from __future__ import annotations

import gc
import sys
import tracemalloc
from functools import cache
from itertools import product

import numpy as np
import pytest
from numba.core import event
from support.controller_cases import (
    CASES,
    POSITIONS,
    body_of,
    config,
    emulator,
    make,
    motion,
    moved,
    robot,
    stands_free,
    state_of,
)

from hoap3.protocol.messages import STAMP_FIELDS
from hoap3.remote_controller.controllers.acceleration.weighted import WeighedController
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.service import rehearse
from hoap3.tools.simulate import simulate

LENGTH = 1200  # ticks of the motion that is looked at
ULP = np.finfo(float).eps
every_controller = pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=pytest.mark.slow if stands_free(case) else ()) for case in CASES],
)
LAWS = {config(case).controller: case for case in reversed(CASES)}  # a config of each
of_each_law = pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=() if case in LAWS.values() else pytest.mark.slow) for case in CASES],
)
every_one_of_positions = pytest.mark.parametrize("case", POSITIONS)


def run(case: str, duration: float, **changes: str):
    return simulate(emulator(case).model_copy(update=changes), config(case), duration)


@cache
def two_seconds(case: str, posture: str):
    """The setpoints of a motion, and the references that the robot applied."""
    simulation = run(case, 2.0, posture=posture)
    return simulation.setpoints, simulation.states["reference"]


@every_one_of_positions
def test_it_obeys_the_limits_of_the_robot_at_every_tick(case):
    description = robot(case)
    answers, applied = two_seconds(case, emulator(case).posture)
    setpoints = answers["values"]
    count = len(setpoints)
    assert count >= 2000
    assert (setpoints >= description.lower_hard).all()
    assert (setpoints <= description.upper_hard).all()
    step = np.abs(setpoints - applied[:count])
    assert (step <= description.velocity * description.period_s + ULP * np.abs(setpoints)).all()
    assert (applied >= description.lower).all()
    assert (applied <= description.upper).all()
    # what it certifies, the robot took over bit by bit: there was nothing to hold back
    certified = answers["solver_status"][:-1] == STATUS["certified"]
    np.testing.assert_array_equal(applied[1:count][certified], setpoints[:-1][certified])


@of_each_law
def test_two_runs_give_the_same_bytes(case):
    first, second = run(case, 0.5), run(case, 0.5)
    assert [record.payload for record in first.records] == [
        record.payload for record in second.records
    ]


@of_each_law
def test_its_answers_follow_from_reset_and_states_alone(case):
    payloads, setpoints = motion(case)
    first, last = 300, setpoints[299]
    states = [state_of(robot(case), payload) for payload in payloads[first : first + 200]]

    fresh = make(case)
    fresh.reset(states[0], last)
    expected = [without_stamps(fresh.step(state)) for state in states]

    used = make(case)
    clock = iter(range(10**9))
    used.now = lambda: next(clock)  # and time is not an input
    used.reset(state_of(robot(case), payloads[900]), setpoints[5])
    for payload in payloads[900:1100]:
        used.step(state_of(robot(case), payload))
    used.reset(states[0], last)
    assert [without_stamps(used.step(state)) for state in states] == expected


def without_stamps(command) -> bytes:
    for name in STAMP_FIELDS:
        setattr(command, name, 0)
    return command.dump()


LATER = [pytest.param(tick, marks=pytest.mark.long) for tick in (1, LENGTH - 1)]


@every_one_of_positions
@pytest.mark.parametrize("tick", [0, 250, *LATER])
@pytest.mark.parametrize("last", ["none", "the last", "zeros", "far"])
def test_it_starts_anywhere_without_a_jump(case, tick, last):
    payloads, setpoints = motion(case)
    state = state_of(robot(case), payloads[tick])
    controller = make(case)
    controller.reset(
        state,
        {
            "none": None,
            "the last": setpoints[max(tick - 1, 0)],
            "zeros": np.zeros(robot(case).n),
            "far": robot(case).upper.copy(),
        }[last],
    )
    jump = np.abs(controller.step(state).values - state.reference)
    allowed = robot(case).velocity
    u_max = getattr(controller.parameters, "u_max_rad_s", None)
    if u_max is not None:
        allowed = np.minimum(allowed, u_max)
    assert (jump <= allowed * robot(case).period_s + ULP * np.abs(state.reference)).all()


FAMILIES = [  # of one robot each
    [case for case in POSITIONS if robot(case).name == name]
    for name in dict.fromkeys(robot(case).name for case in POSITIONS)
]
PAIRS = [
    pytest.param(
        *pair, marks=() if pair in zip(cases, following, strict=True) else pytest.mark.long
    )
    for cases in FAMILIES
    for following in [[*cases[1:], *cases[:1]]]
    for pair in product(cases, cases)
]


@pytest.mark.parametrize(("case", "successor"), PAIRS)
@pytest.mark.parametrize("warm", [False, True], ids=["cold", "shadowing"])
@pytest.mark.parametrize(
    "tick", [400, *(pytest.param(tick, marks=pytest.mark.long) for tick in (50, 1000))]
)
def test_another_takes_over_without_a_jump(case, successor, warm, tick):
    """Joints faster than what the robot can stop in a period are slowed down by its filter."""
    payloads, setpoints = motion(case)
    controller = make(successor)
    if warm:  # it followed in silence, as a second process does before it takes over
        shadowed = [state_of(robot(case), payload) for payload in payloads[tick - 50 : tick]]
        controller.reset(shadowed[0], None)
        for state in shadowed:
            controller.step(state)
    state = state_of(robot(case), payloads[tick])
    controller.reset(state, setpoints[tick - 1])
    dt = robot(case).period_s
    after = (controller.step(state).values - setpoints[tick - 1]) / dt
    before = (setpoints[tick - 1] - setpoints[tick - 2]) / dt
    at_once = robot(case).setpoint_acceleration_max * dt
    slow = np.abs(before) <= at_once
    assert (np.abs(after - before)[slow] <= at_once[slow]).all()


POSTURES = [
    pytest.param(case, posture, marks=pytest.mark.slow if place or stands_free(case) else ())
    for case in CASES
    for place, posture in enumerate(robot(case).postures)
]


@pytest.mark.parametrize(("case", "posture"), POSTURES)
def test_its_certificates_hold(case, posture):
    setpoints, _ = two_seconds(case, posture)
    status = setpoints["solver_status"]
    assert set(status) <= set(STATUS.values())
    for field in setpoints.dtype.names:
        assert np.isfinite(setpoints[field]).all(), field
    proven = status == STATUS["certified"]
    v = setpoints["v"]
    allowed = 4 * ULP * v[:-1] + second_order(case, setpoints)
    falls = (proven & (setpoints["v_rate_required"] <= 0.0))[:-1]
    assert (np.diff(v)[falls] <= allowed[falls]).all()
    certified = setpoints[proven]
    required, predicted = certified["v_rate_required"], certified["v_rate_predicted"]
    assert (v >= 0.0).all()
    assert (predicted <= required + 1e-9 * np.abs(required)).all()
    assert (certified["kkt_residual"] >= 0.0).all()
    assert (certified["kkt_residual"] <= 1e-9).all()
    assert (certified["rho"] >= 0.0).all()
    assert (certified["rho"] <= 1.0).all()
    resting = setpoints[status == STATUS["at_target"]]
    assert (resting["v_rate_required"] == 0.0).all()


def second_order(case: str, setpoints: np.ndarray) -> float:
    """By how much V may rise in a tick where its target moves: 0 where it names no `drift`.

    |∂V/∂t| = |e·w| of a target's velocity w, so drift/|e| is at most its speed. Both w and what
    the robot makes of it move e by w·T, of which V = |e|²/2 predicts the first order only.
    """
    names = make(case).extra_names
    if "drift" not in names:
        return 0.0
    drift = np.abs(setpoints["extra"][:, names.index("drift")])
    moves = drift > 0.0
    speed = np.max(drift[moves] / np.sqrt(2.0 * setpoints["v"][moves]), initial=0.0)
    return float((2.0 * speed * robot(case).period_s) ** 2 / 2.0)


@every_one_of_positions
@pytest.mark.parametrize("tick", [0, 10, 100, 300, 700])
def test_its_prediction_of_v_is_the_derivative_along_the_motion(case, tick):
    payloads, _ = motion(case)
    state = state_of(robot(case), payloads[tick])
    controller = make(case)
    controller.reset(state, None)
    command = controller.step(state)
    if command.solver_status != STATUS["certified"]:
        return  # it promises nothing here
    v, predicted = command.v, command.v_rate_predicted
    move, start = command.values - state.reference, state.reference.copy()
    errors = []
    for share in (1.0, 0.5, 0.25):
        state.reference[:] = start + share * move
        state.q[:] = state.reference
        controller.reset(state, None)
        slope = (controller.step(state).v - v) / (share * robot(case).period_s)
        errors.append(abs(slope - predicted))
    rounding = 100 * ULP * v / robot(case).period_s
    assert errors[0] <= 0.02 * abs(predicted) + rounding
    assert errors[1] <= 0.6 * errors[0] + rounding  # of first order in the period
    assert errors[2] <= 0.6 * errors[1] + rounding


@of_each_law
def test_it_keeps_nothing_of_what_it_allocates(case):
    payloads, _ = motion(case)
    states = [state_of(robot(case), payload) for payload in payloads[:100]]
    controller = make(case)
    rehearse(controller, robot(case))
    controller.reset(states[0], None)
    gc.collect()
    tracemalloc.start()
    try:
        for state in states:  # fills whatever has a bound
            controller.step(state)
        gc.collect()
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(2):
            for state in states:
                controller.step(state)
        gc.collect()
        growth = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert growth <= 1024  # a few numbers of another size; a float kept per step were 4,800


@of_each_law
def test_its_rehearsal_leaves_nothing_to_compile_or_import(case):
    payloads, _ = motion(case)
    controller = make(case)
    rehearse(controller, robot(case))
    states = [state_of(robot(case), payload) for payload in payloads[:100]]
    modules = set(sys.modules)
    with event.install_recorder("numba:compile") as compiled:
        controller.reset(states[0], None)
        for state in states:
            controller.step(state)
    assert not compiled.buffer
    assert set(sys.modules) == modules


@every_controller
def test_it_writes_into_its_own_command_only(case):
    payloads, setpoints = motion(case)
    controller, other = make(case), make(case)
    alone = make(case)
    last = setpoints[99].copy()
    for each in (controller, alone):
        each.reset(state_of(robot(case), payloads[100]), last)
    other.reset(state_of(robot(case), payloads[700]), None)
    for tick in range(100, 200):
        state = state_of(robot(case), payloads[tick])
        command = controller.step(state)
        assert command is controller.command
        assert state.dump() == payloads[tick]
        written = command.dump()
        other.step(state_of(robot(case), payloads[tick + 600]))
        assert command.dump() == written
        assert alone.step(state).dump() == written
    np.testing.assert_array_equal(last, setpoints[99])


def exactness(controller):
    """How exactly a QP of a robot on its soles is solved: nεκ of its matrix, else 0.

    Backward stable elimination does no better (Higham, Accuracy and Stability, Theorem 10.4), and
    weights there lie 1e7 apart.
    """
    if not isinstance(controller, WeighedController) or controller.parameters.base == "fixed":
        return 0.0
    sizes = controller.tasks.sizes
    J = (
        np.sqrt(np.repeat(controller.importance.value, sizes))[:, None]
        * controller.problem.jacobian
    )
    s = np.linalg.svd(J, compute_uv=False)
    return J.shape[1] * ULP * (s[0] / s[J.shape[1] - 1]) ** 2


@every_controller
def test_the_order_of_joints_on_the_wire_does_not_matter(case):
    straight = robot(case)
    order = np.random.default_rng(5).permutation(straight.n)
    shuffled = straight.model_copy(
        update={
            "joints": tuple(straight.joints[i] for i in order),
            "postures": {
                name: tuple(values[i] for i in order) for name, values in straight.postures.items()
            },
        }
    )
    body, controller = body_of(case, shuffled), make(case, shuffled)
    controller.reset(body.state, None)
    setpoints = np.array([values for _, values in moved(controller, body, 300)])
    expected = motion(case)[1][:300]
    atol = max(1e-9, exactness(controller) * np.abs(expected).max())
    np.testing.assert_allclose(setpoints, expected[:, order], rtol=0, atol=atol)
    assert np.abs(expected[-1] - straight.initial_position).max() > 1e-3  # it moved at all


@every_controller
def test_it_gives_nothing_to_follow_for_a_state_that_is_not_finite(case):
    payloads, _ = motion(case)
    state = state_of(robot(case), payloads[100])
    controller = make(case)
    controller.reset(state, None)
    for array in (state.q, state.dq, state.tau, state.reference):
        array[0] = np.nan
    command = controller.step(state)
    assert command.solver_status != STATUS["certified"]
    assert not np.isfinite(command.values).all()  # so the robot refuses it
