"""What all velocity controllers share: the Euler step, what is certified, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from com_runs import HOAP3, controller_for
from free_flyer import FreeFlyer
from support.small_arm import arm, one_joint_arm

from hoap3.protocol.errors import BadProblemError, ConfigError
from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.base import STATUS, VelocityController
from hoap3.robot_emulator.filters.position import PositionFilter

LAWS = [("qp12", {}), ("qp12", {"gamma": 1.0}), ("pinv", {}), ("pinv", {"law": "plain"})]
each_law = pytest.mark.parametrize(("name", "law"), LAWS, ids=str)


class Given(VelocityController):
    """Does what the test says."""

    u = np.zeros(3)

    def velocity(self, state: State) -> FloatArray:
        self.command.solver_status = STATUS["certified"]
        return self.u


def agile(acceleration: float = 4000.0) -> RobotDescription:
    """The arm with another setpoint_acceleration_max [rad/s²]; it still is 3 rad/s fast."""
    change = {"setpoint_acceleration_max": acceleration}
    return arm(joints=tuple(joint.model_copy(update=change) for joint in arm().joints))


def given(*u: float, robot: RobotDescription | None = None, **parameters: str) -> Given:
    controller = Given(robot or arm(), Given.Parameters(**parameters))
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
    state = state_at(agile(), np.array([0.0, 1.999, 0.0]))  # to 2.0, and 3 rad/s
    status = given(*u, robot=agile()).step(state).solver_status
    assert status == STATUS["certified" if certified else "uncertified"]


def followed(tick: int, reference: FloatArray, skipped: int = 0) -> State:
    """A State of a robot that follows since tick 0."""
    state = state_at(arm(), reference)
    state.mode, state.tick, state.skipped = State.ACTIVE, tick, skipped
    return state


def statuses(controller: Given, *states: State) -> list[str]:
    names = {value: name for name, value in STATUS.items()}
    return [names[controller.step(state).solver_status] for state in states]


@pytest.mark.parametrize(
    ("u", "certified"),
    [(0.5, True), (1.4, True), (1.5, True), (-0.5, True), (1.51, False), (-0.51, False)],
)
def test_a_change_of_velocity_that_the_robot_does_not_do_is_not_certified(u, certified):
    """The arm takes 1000 rad/s², which is 1 rad/s in a period."""
    controller = given(0.5, 0.0, 0.0)
    before = followed(0, np.zeros(3))
    after = followed(1, before.reference + controller.step(before).values)
    assert controller.command.solver_status == STATUS["certified"]
    controller.u = np.array([u, 0.0, 0.0])
    expected = "certified" if certified else "uncertified"
    assert statuses(controller, after) == [expected]


@pytest.mark.parametrize("mode", [State.IDLE, State.ACTIVE])
def test_a_robot_that_begins_to_follow_rests(mode):
    for u, expected in ((0.9, "certified"), (1.1, "uncertified")):
        state = followed(70, np.full(3, 0.1))
        state.mode, state.epoch_from_tick = mode, 70
        assert statuses(given(u, 0.0, 0.0), state) == [expected]


def test_the_periods_that_a_robot_slept_through_are_none():
    controller = given(0.9, 0.0, 0.0)
    first = followed(0, np.zeros(3))
    second = followed(4, np.array([9e-4, 0.0, 0.0]), skipped=3)
    controller.step(first)
    controller.u = np.array([1.8, 0.0, 0.0])
    assert statuses(controller, second) == ["certified"]


def test_after_a_state_that_was_missed_one_answer_is_not_certified():
    controller = given(0.0, 0.0, 0.0)
    states = [followed(tick, np.zeros(3)) for tick in (0, 1, 3, 4)]
    expected = ["certified", "certified", "uncertified", "certified"]
    assert statuses(controller, *states) == expected


def test_while_the_robot_catches_up_with_an_answer_nothing_is_certified():
    controller = given(2.5, 0.0, 0.0)  # the robot does 1 rad/s of it
    assert statuses(controller, followed(0, np.zeros(3))) == ["uncertified"]
    controller.u = np.array([0.9, 0.0, 0.0])
    held_back = followed(1, np.array([1e-3, 0.0, 0.0]))
    assert statuses(controller, held_back) == ["uncertified"]
    controller.u = np.array([1.5, 0.0, 0.0])
    assert statuses(controller, followed(2, np.array([1.9e-3, 0.0, 0.0]))) == ["certified"]


def test_who_heads_for_a_wall_faster_than_it_can_brake_is_not_certified():
    states = [followed(tick, np.array([1.99 + 3e-3 * tick, 0.0, 0.0])) for tick in range(3)]
    controller = given(3.0, 0.0, 0.0)
    controller.step(states[0])
    assert statuses(controller, *states[1:]) == ["certified", "uncertified"]


@pytest.mark.parametrize(
    ("u", "expected"), [(0.0, "certified"), (-0.5, "certified"), (0.5, "uncertified")]
)
def test_a_joint_whose_reference_rests_beyond_its_range_may_stay_there_but_not_go_on(u, expected):
    """Where servos give way, what holds a joint at its limit lies beyond it."""
    beyond = np.array([2.0005, 0.0, 0.0])  # its range ends at 2 rad
    robot = PositionFilter(arm(), 1e-3)
    robot.reset(beyond)
    controller = given(u, 0.0, 0.0)
    assert statuses(controller, followed(0, beyond)) == [expected]
    assert (robot.follow(controller.command.values, 0) < 0) == (expected == "certified")


@pytest.mark.slow
def test_what_is_certified_the_robot_takes_over_bit_by_bit():
    """Random velocities about all limits: the robot's own filter is the judge."""
    rng = np.random.default_rng(11)
    robot = PositionFilter(arm(), arm().period_s)
    controller, seen = given(0.0, 0.0, 0.0), {"certified": 0, "uncertified": 0}
    for tick in range(4000):
        if tick % 100 == 0:
            robot.reset(rng.uniform(-2.0, 2.0, 3))
        state = followed(tick, robot.value)
        state.epoch_from_tick = tick // 100 * 100
        aim = robot.rate + rng.uniform(-1.1, 1.1, 3) * rng.choice([1.0, 0.3])
        controller.u = np.clip(aim, -3.02, 3.02)
        (found,) = statuses(controller, state)
        seen[found] += 1
        held = robot.follow(controller.command.values, tick)
        assert (held < 0) == (found == "certified"), tick
    assert min(seen.values()) > 500


@pytest.mark.parametrize("count", [2, 4])
def test_velocities_of_another_length_are_refused(count):
    with pytest.raises(BadProblemError, match=rf"Given.velocity.* {count} .* 3 "):
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
    controller = controller_for(
        arm(), name, point="com", reference_frame="base", target_m=target, **law
    )
    command = controller.step(state_at(arm(), stretched))
    assert command.v > 0.1
    assert command.solver_status == STATUS["uncertified"]
    assert controller.is_stationary
    np.testing.assert_array_equal(command.values, 0.0)


@each_law
@pytest.mark.parametrize("count", [1, 3])
def test_an_arm_of_few_joints_is_moved_towards_the_target(name, law, count):
    robot = arm() if count == 3 else one_joint_arm()
    q = np.full(count, 0.3)
    floating = FreeFlyer(robot)
    target = floating.com("base", q + 0.2)[0]
    controller = controller_for(
        robot, name, point="com", reference_frame="base", target_m=target.tolist(), **law
    )
    state, far = state_at(robot, q), np.inf
    for _ in range(200):
        command = controller.step(state)
        assert (command.solver_status == STATUS["certified"]) == (command.margin >= 0.0)
        assert command.v < far
        far = command.v
        state.q[:] = state.reference[:] = command.values
