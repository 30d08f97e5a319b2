"""What all velocity controllers share: the Euler step, what is certified, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from com_runs import HOAP3, controller_for
from controller_cases import one_joint_arm
from free_flyer import FreeFlyer
from small_arm import arm

from protocol.description import RobotDescription
from protocol.errors import BadProblemError, ConfigError
from protocol.messages import FloatArray, State
from remote_controller.controllers.controller import STATUS, VelocityController

LAWS = [("qp12", {}), ("qp12", {"gamma": 1.0}), ("pinv", {}), ("pinv", {"law": "plain"})]
each_law = pytest.mark.parametrize(("name", "law"), LAWS, ids=str)


class Given(VelocityController):
    """Does what the test says."""

    u = np.zeros(3)

    def velocity(self, state: State) -> FloatArray:
        self.command.solver_status = STATUS["certified"]
        return self.u


def given(*u: float, **parameters: str) -> Given:
    controller = Given(arm(), Given.Parameters(**parameters))
    controller.u = np.array(u)
    return controller


def state_at(description: RobotDescription, q: FloatArray) -> State:
    state = State(description.n)
    state.q[:] = state.reference[:] = q
    return state


@pytest.mark.parametrize("source", ["reference", "measured"])
def test_the_setpoint_is_one_euler_step_on(source):
    rng = np.random.default_rng(6)
    for _ in range(100):
        controller = given(*rng.uniform(-1, 1, 3), integrate_from=source)
        state = State(3)
        state.q[:], state.reference[:] = rng.uniform(-1, 1, (2, 3))
        start = state.q if source == "measured" else state.reference
        np.testing.assert_array_equal(controller.step(state).values, start + controller.u * 1e-3)


def test_a_joint_is_active_from_a_thousandth_on():
    for slow in (0.0, 0.000999, -0.000999):
        assert given(slow, 0.001, -0.001).step(State(3)).active_joints == 2


@pytest.mark.parametrize(
    ("u", "certified"),
    [
        ((0.0, 1.0, 0.0), True),
        ((0.0, 1.1, 0.0), False),
        ((0.0, -1.0, 3.0), True),
        ((0.0, 0.0, 3.001), False),
        ((0.0, 0.0, -3.001), False),
        ((np.nan, 0.0, 0.0), False),
    ],
)
def test_only_what_the_robot_takes_over_is_certified(u, certified):
    state = state_at(arm(), np.array([0.0, 1.999, 0.0]))  # to 2.0, and 3 rad/s
    status = given(*u).step(state).solver_status
    assert status == STATUS["certified" if certified else "uncertified"]


@pytest.mark.parametrize("count", [2, 4])
def test_velocities_of_another_length_are_refused(count):
    with pytest.raises(BadProblemError, match=f"Given.velocity gave {count} values for 3 joints"):
        given(*[0.0] * count).step(State(3))


def test_a_misspelt_source_is_refused():
    with pytest.raises(ConfigError, match="integrate_from"):
        controller_for(HOAP3, "qp12", integrate_from="measures")


@each_law
def test_an_unusable_measurement_holds_the_reference(name, law):
    controller, state = controller_for(HOAP3, name, **law), state_at(HOAP3, HOAP3.initial_position)
    for nothing in (np.nan, np.inf):
        state.q[3] = nothing
        command = controller.step(state)
        np.testing.assert_array_equal(command.values, state.reference)
        assert command.solver_status == STATUS["infeasible"]
    again = controller.step(state_at(HOAP3, HOAP3.initial_position))
    assert again.solver_status != STATUS["infeasible"]
    assert again.active_joints > 0


@each_law
def test_exactly_at_the_target_it_says_so_and_rests(name, law):
    state = state_at(HOAP3, HOAP3.initial_position)
    controller = controller_for(HOAP3, name, **law)
    controller.step(state)
    target = controller.task.position.tolist()
    command = controller_for(HOAP3, name, target_m=target, **law).step(state)
    assert command.solver_status == STATUS["at_target"]
    assert (command.v, command.v_rate_required, command.v_rate_predicted) == (0.0, 0.0, 0.0)
    np.testing.assert_array_equal(command.values, state.reference)


@each_law
def test_where_no_joint_changes_v_it_rests(name, law):
    """The arm is stretched, and the target lies beyond: ∇V = 0 although e is not."""
    stretched = np.zeros(3)
    target = (0.0, 0.0, 1.0)
    controller = controller_for(arm(), name, frame="base", target_m=target, **law)
    command = controller.step(state_at(arm(), stretched))
    assert command.v > 0.1
    assert command.solver_status == STATUS["at_target"]
    np.testing.assert_array_equal(command.values, 0.0)


@each_law
@pytest.mark.parametrize("count", [1, 3])
def test_an_arm_of_few_joints_is_moved_towards_the_target(name, law, count):
    robot = arm() if count == 3 else one_joint_arm()
    q = np.full(count, 0.3)
    floating = FreeFlyer(robot)
    target = floating.com("base", q + 0.2)[0]
    controller = controller_for(robot, name, frame="base", target_m=target.tolist(), **law)
    state, far = state_at(robot, q), np.inf
    for _ in range(200):
        command = controller.step(state)
        assert (command.solver_status == STATUS["certified"]) == (command.margin >= 0.0)
        assert command.v < far
        far = command.v
        state.q[:] = state.reference[:] = command.values
