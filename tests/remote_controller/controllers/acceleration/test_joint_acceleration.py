"""`joint_acceleration`: to a posture within limits, by positions or accelerations."""

from __future__ import annotations

import numpy as np
import pytest

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import COMMANDS, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.controllers.acceleration.joint_acceleration import (
    JointAccelerationController,
)
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.robot_emulator.robots import load
from hoap3.testing import Body
from hoap3.tools.services.simulate import simulate

HOAP3, LWR = load("hoap3"), load("lwr")
T = 1e-3


def controller_for(
    description: RobotDescription, **parameters: object
) -> JointAccelerationController:
    content = {"controller": "joint_acceleration", "parameters": parameters}
    return build(parse(ControllerConfig, content, "test"), description, "test")


def moved(controller, body, ticks):
    """Setpoints and applied references of a motion, (ticks, n) each."""
    controller.reset(body.state, None)
    setpoints, references = [], []
    for _ in range(ticks):
        setpoints.append(controller.step(body.state).values.copy())
        references.append(body.state.reference.copy())
        body.follow(setpoints[-1])
    return np.array(setpoints), np.array(references)


@pytest.mark.parametrize("posture", ["walk_ready", "q0_arms_forward", "zero"])
def test_hoap3_gets_to_a_posture_within_its_limits(posture):
    parameters = {"posture": posture, "kp": 400.0}
    law = {"controller": "joint_acceleration", "parameters": parameters}
    run = simulate("hoap3", law, duration=3.0)
    references = run.states["reference"]
    goal = np.clip(HOAP3.postures[posture], HOAP3.lower, HOAP3.upper)
    np.testing.assert_allclose(references[-1], goal, atol=1e-4)
    assert (references >= HOAP3.lower).all()
    assert (references <= HOAP3.upper).all()
    speeds = np.diff(references, axis=0) / T
    assert (np.abs(speeds) <= HOAP3.velocity).all()
    accelerations = np.diff(speeds, axis=0) / T
    assert np.abs(accelerations).max() <= HOAP3.brake_acceleration.max() * (1 + 1e-6)
    assert set(run.setpoints["solver_status"]) <= {STATUS["certified"], STATUS["at_target"]}


def aggressive(kind: str, **more: object) -> tuple[np.ndarray, np.ndarray]:
    """A reference outside the range, and the gains of the paper."""
    outside = np.array(LWR.initial_position)
    outside[0] = LWR.upper[0] + 0.1
    parameters = {"posture_rad": tuple(outside), "kp": 1000.0, "bounds": {"kind": kind, **more}}
    return moved(controller_for(LWR, **parameters), Body(LWR), 4000)


def test_a_joint_that_is_driven_against_its_limit_comes_to_rest_there():
    setpoints, references = aggressive("viability")
    np.testing.assert_array_equal(setpoints[:-1], references[1:])  # nothing was held back
    assert (setpoints <= LWR.upper).all()
    assert LWR.upper[0] - setpoints[-1, 0] <= 2e-9
    speeds = np.diff(setpoints[:, 0]) / T
    assert np.abs(np.diff(speeds) / T)[-500:].max() <= 1e-3
    assert speeds.max() > 0.5


def test_naive_bounds_have_it_run_into_the_limit_and_the_robot_stops_it():
    setpoints, references = aggressive("naive")
    speeds = np.diff(references[:, 0]) / T
    assert setpoints[:, 0].max() > LWR.upper[0] >= references[:, 0].max()
    hardest = np.abs(np.diff(speeds) / T).max()
    assert hardest == pytest.approx(LWR.setpoint_acceleration_max[0])
    assert hardest > 1.5 * LWR.brake_acceleration[0]


def test_on_a_robot_of_accelerations_it_commands_them():
    law = {"controller": "joint_acceleration", "parameters": {"posture": LWR.initial_posture}}
    start = next(name for name in LWR.postures if name != LWR.initial_posture)
    robot = {"robot": "lwr", "command": "acceleration", "posture": start}
    run = simulate(robot, law, duration=4.0)
    assert (run.setpoints["command"] == COMMANDS["acceleration"]).all()
    states = run.states
    np.testing.assert_allclose(states["q"][-1], LWR.initial_position, atol=1e-5)
    assert (np.abs(states["dq"]) <= LWR.velocity).all()
    assert (states["q"] >= LWR.lower).all()
    assert (states["q"] <= LWR.upper).all()
    ddq = np.diff(states["dq"], axis=0)[: len(run.setpoints) - 1] / T
    np.testing.assert_allclose(ddq, run.setpoints["values"][:-1], atol=1e-9)
    assert np.abs(ddq).max() > 1.0


def test_the_first_setpoint_goes_on_with_the_motion_of_the_robot():
    controller = controller_for(HOAP3, posture="walk_ready")
    state = State(HOAP3.n)
    state.q[:] = state.reference[:] = HOAP3.initial_position
    state.dq[:] = 0.2
    controller.reset(state, np.full(HOAP3.n, 9.0))
    step = controller.step(state).values - state.reference
    bound = 0.5 * T * T * HOAP3.brake_acceleration
    assert (np.abs(step - T * state.dq) <= bound * (1 + 1e-6)).all()


def test_where_the_robot_did_something_else_it_begins_there_anew():
    controller, body = controller_for(HOAP3, posture="walk_ready"), Body(HOAP3)
    moved(controller, body, 100)
    before = body.state.reference.copy()
    controller.step(body.state)
    body.follow(before + 1e-4)  # not what was asked for
    reference = body.state.reference.copy()
    step = controller.step(body.state).values - reference
    bound = 0.5 * T * T * HOAP3.brake_acceleration
    assert (np.abs(step - (reference - before)) <= bound * (1 + 1e-6)).all()


def test_a_missed_state_does_not_double_its_velocity():
    controller = controller_for(HOAP3, posture="walk_ready")
    state = State(HOAP3.n)
    state.q[:] = state.reference[:] = HOAP3.initial_position
    controller.reset(state, None)
    controller.step(state)
    state.tick = 4
    state.reference += 4e-4  # 0.1 rad/s over four periods
    step = controller.step(state).values - state.reference
    bound = 0.5 * T * T * HOAP3.brake_acceleration
    assert (np.abs(step - 1e-4) <= bound * (1 + 1e-6)).all()


def test_while_it_moves_away_it_says_so():
    controller = controller_for(HOAP3, posture="walk_ready")
    state = State(HOAP3.n)
    state.q[:] = state.reference[:] = HOAP3.initial_position
    away = np.array(HOAP3.initial_position) - HOAP3.postures["walk_ready"]
    state.dq[:] = away
    controller.reset(state, None)
    command = controller.step(state)
    assert command.v_rate_required > command.v_rate_predicted > 0.0


def test_after_a_state_that_is_not_finite_it_goes_on_with_the_robots_motion():
    controller, body = controller_for(HOAP3, posture="walk_ready"), Body(HOAP3)
    moved(controller, body, 100)
    broken = State(HOAP3.n)
    broken.load(body.state.dump())
    broken.reference[3] = np.nan
    assert np.isnan(controller.step(broken).values).all()
    assert controller.present == 1
    step = controller.step(body.state).values - body.state.reference
    bound = 0.5 * T * T * HOAP3.brake_acceleration
    assert (np.abs(step - T * body.state.dq) <= bound * (1 + 1e-6)).all()


WRONG = {
    "posture": {"posture": "handstand"},
    "posture_rad": {"posture_rad": (0.1, 0.2)},
    "bounds.acceleration_max": {"bounds": {"acceleration_max": (1.0, 2.0)}},
    "bounds": {"bounds": {"horizon_periods": 1e4}},
    "kp": {"kp": -1.0},
}


@pytest.mark.parametrize("key", WRONG)
def test_settings_that_do_not_fit_are_refused_by_their_key(key):
    with pytest.raises(ConfigError) as refused:
        controller_for(HOAP3, **WRONG[key])
    assert refused.value.key == f"parameters.{key}"
