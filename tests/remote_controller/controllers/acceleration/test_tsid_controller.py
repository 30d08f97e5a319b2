"""`tsid` on a Baxter arm: the goal is reached, the limits hold, and what it says is so."""

from __future__ import annotations

import numpy as np
import pytest
from tsid_runs import ACCELERATIONS, EXACT, baxter, exact_motion, tsid

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import COMMANDS, State
from hoap3.protocol.robot.rigid_body_dynamics import Dynamics
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.model.frame_dynamics import FramesDynamics
from hoap3.tools.services.configs import load_controller_config, load_emulator_config
from hoap3.tools.services.simulate import Lockstep, Simulation, simulate

E1 = 3  # the elbow
T = 1e-3


def state_at(controller, q=None, dq=None) -> State:
    state = State(controller.description.n)
    state.q[:] = controller.description.initial_position if q is None else q
    state.dq[:] = 0.0 if dq is None else dq
    controller.reset(state, None)
    return state


def log_norm(simulation: Simulation) -> np.ndarray:
    return np.sqrt(2.0 * simulation.setpoints["v"])


@pytest.fixture(scope="module")
def shipped() -> Simulation:
    return simulate("baxter", "tsid_baxter", duration=4.0)


def test_the_hand_comes_to_its_goal_and_every_cycle_is_certified(shipped):
    assert (shipped.setpoints["solver_status"] == STATUS["certified"]).all()
    assert (shipped.setpoints["kkt_residual"] <= 1e-9).all()
    assert (shipped.setpoints["fallback"] == 0).all()
    assert (shipped.setpoints["command"] == COMMANDS["torque"]).all()
    assert log_norm(shipped)[0] > 1.0
    assert log_norm(shipped)[-1] < 5e-3


def test_position_velocity_and_acceleration_stay_within_limits_at_every_tick(shipped):
    robot, states = baxter(), shipped.states
    assert (states["q"] >= robot.lower).all()
    assert (states["q"] <= robot.upper).all()
    assert (np.abs(states["dq"]) <= robot.velocity).all()
    ddq = np.diff(states["dq"], axis=0) / T
    assert (np.abs(ddq) <= robot.brake_acceleration).all()
    assert states["q"][:, E1].min() < robot.lower[E1] + 0.005  # and the elbow did come near
    torques = shipped.setpoints["values"]
    assert (np.abs(torques) <= robot.effort * (1 + 1e-9)).all()
    assert np.abs(torques[:, 1]).max() == pytest.approx(robot.effort[1])


def test_at_its_limit_the_elbow_does_not_hammer(shipped):
    """Once it is there, and until it leaves, torques change by little from tick to tick."""
    robot, states = baxter(), shipped.states
    there = np.flatnonzero(states["q"][:, E1] < robot.lower[E1] + 4.1e-3)
    torques = shipped.setpoints["values"]
    steps = np.abs(np.diff(torques[there[0] + 20 : there[-1] - 20], axis=0))
    assert len(steps) > 100
    assert steps.max() < 0.5


def test_an_arm_that_cannot_hold_its_load_is_told_of_and_not_certified():
    """Stretched forward, s1 needs 57 N m and has 50."""
    robot = baxter(initial_posture="zero")
    controller = tsid(robot, goal={"posture": "zero"})
    command = controller.step(state_at(controller))
    assert command.solver_status in {STATUS["uncertified"], STATUS["infeasible"]}
    told = [name for bit, name in enumerate(controller.conditions) if controller.present >> bit & 1]
    assert "cannot hold its load" in told


def test_the_robot_has_nothing_to_hold_back():
    sides = load_emulator_config("baxter", seed=0)[0], load_controller_config("tsid_baxter")[0]
    lockstep = Lockstep(*sides, MemoryRecorder(), MemoryRecorder())
    lockstep.run(2.0)
    setpoint_filter = lockstep.robot._setpoint_filter
    assert (setpoint_filter.interventions, setpoint_filter.torque_limited) == (0, 0)


def fig5(kind: str) -> dict[str, object]:
    return {
        "kind": kind,
        "horizon_periods": 2.0,
        "acceleration_max": ACCELERATIONS,
        "shrink": True,
        **EXACT,
    }


def test_naive_bounds_let_the_elbow_run_through_its_limit():
    robot = baxter(period_s=0.01, fast=2.0)
    motion = exact_motion(tsid(robot, bounds=fig5("naive"), compensate_friction=False), 4.0)
    room = motion.q[:, E1] - robot.lower[E1]
    last = int(np.argmax(room < 0.0)) - 1  # the last tick within
    assert last > 0
    crossing = (last + room[last] / (room[last] - room[last + 1])) * robot.period_s
    assert crossing == pytest.approx(0.36, abs=0.01)
    assert motion.dq[last, E1] == pytest.approx(-1.38, abs=0.05)


def test_viability_bounds_never_do_and_the_hand_arrives():
    robot = baxter(period_s=0.01, fast=2.0)
    motion = exact_motion(tsid(robot, bounds=fig5("viability"), compensate_friction=False), 4.0)
    assert (motion.q >= robot.lower).all()
    assert (motion.q <= robot.upper).all()
    assert (np.abs(motion.dq) <= robot.velocity * (1 + 1e-12)).all()
    assert 0.0 <= (motion.q[:, E1] - robot.lower[E1]).min() < 1e-4
    assert np.sqrt(2 * motion.v[-1]) < 5e-3
    assert motion.fallbacks == 0


def test_torques_are_those_of_the_accelerations_friction_at_the_end_of_the_period():
    robot = baxter()
    rigid, tau = Dynamics(robot), np.zeros(robot.n)
    rng = np.random.default_rng(2)
    for friction in (True, False):
        controller = tsid(robot, compensate_friction=friction)
        dq = 0.2 * rng.normal(size=robot.n)
        command = controller.step(state_at(controller, dq=dq))
        ddq = controller.solver.ddq
        rigid.inverse(robot.initial_position.copy(), dq, ddq, tau)
        if friction:
            tau += rigid.damping * (dq + T * ddq)
        np.testing.assert_allclose(command.values, tau, rtol=1e-10, atol=1e-10)


def test_gravity_that_the_robot_adds_is_left_to_it_and_counts_among_the_torques():
    on, added = tsid(baxter(gravity="full")), tsid(baxter(gravity="compensated"))
    q = baxter().initial_position
    alone, rest = (each.step(state_at(each)).values.copy() for each in (on, added))
    weight = np.zeros(7)
    Dynamics(baxter()).gravity(q.copy(), weight)
    np.testing.assert_allclose(rest, alone - weight, atol=1e-10)
    np.testing.assert_array_equal(on.solver.tau, added.solver.tau)
    assert np.abs(weight).max() > 10.0


def test_a_robot_that_takes_accelerations_gets_these():
    controller = tsid(baxter("acceleration"))
    command = controller.step(state_at(controller))
    assert command.command == COMMANDS["acceleration"]
    np.testing.assert_array_equal(command.values, controller.solver.ddq)


def weak() -> object:
    """A Baxter whose torques hold it in few postures."""
    joints = [joint.model_copy(update={"effort": 0.2 * joint.effort}) for joint in baxter().joints]
    return baxter(joints=tuple(joints))


def test_where_torques_are_too_small_the_accelerations_keep_their_bounds_and_it_is_told():
    controller = tsid(weak())
    bit = 1 << controller.conditions.index("torques too small")
    rng, robot = np.random.default_rng(0), controller.description
    fallbacks = 0
    for _ in range(200):
        q, dq = rng.uniform(robot.lower, robot.upper), 0.3 * rng.normal(size=7) * robot.velocity
        command = controller.step(state_at(controller, q, np.clip(dq, -1.0, 1.0)))
        assert (controller.solver.ddq >= controller.bounds.lower).all()
        assert (controller.solver.ddq <= controller.bounds.upper).all()
        assert bool(controller.present & bit) == (command.fallback == 2)
        if command.fallback:
            fallbacks += 1
            assert command.solver_status == STATUS["infeasible"]
            assert command.margin < 0.0
            assert np.isfinite(command.values).all()
            assert command.extra[0] > 1.0
    assert 20 < fallbacks < 200


@pytest.mark.parametrize("kind", ["naive", "none"])
def test_without_bounds_that_keep_the_limits_nothing_is_certified(kind):
    controller = tsid(baxter(), bounds={"kind": kind})
    command = controller.step(state_at(controller))
    assert command.solver_status == STATUS["uncertified"]
    assert command.kkt_residual <= 1e-9


@pytest.mark.parametrize("array", ["q", "dq"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_state_that_is_not_finite_moves_nothing_and_the_next_one_is_answered(array, value):
    controller, fresh = tsid(baxter()), tsid(baxter())
    state = state_at(controller)
    getattr(state, array)[2] = value
    command = controller.step(state)
    assert command.solver_status == STATUS["infeasible"]
    assert np.isnan(command.values).all()
    assert controller.present == 1
    assert controller.conditions[0] == "state not finite"
    good = state_at(fresh)
    np.testing.assert_array_equal(controller.step(good).values, fresh.step(good).values)


def test_a_joint_that_starts_outside_its_bounds_may_stay_and_not_go_on():
    q = baxter().initial_position.copy()
    q[E1] = baxter().lower[E1]  # 4 mrad beyond what is left of the range
    controller = tsid(baxter(), goal={"posture_rad": tuple(q)}, posture={"posture_rad": tuple(q)})
    controller.step(state_at(controller, q))
    assert controller.bounds.lower[E1] == 0.0
    assert controller.bounds.upper[E1] > 1.0


def test_a_goal_is_a_pose_or_where_a_posture_has_the_frame():
    robot = baxter()
    values = robot.postures["fig5_goal"]
    there = FramesDynamics(robot, [], 0).placement(np.array(values), "left_gripper")
    angle = np.arccos((np.trace(there[1]) - 1.0) / 2.0)
    axis = np.array([there[1][2, 1], there[1][0, 2], there[1][1, 0]]) - np.array(
        [there[1][1, 2], there[1][2, 0], there[1][0, 1]]
    )
    turn = angle * axis / np.linalg.norm(axis)
    goals = [
        {"posture": "fig5_goal"},
        {"posture_rad": values},
        {"position_m": tuple(there[0]), "rotation_rad": tuple(turn)},
        {"position_m": tuple(there[0]), "rotation_rad": tuple(turn), "reference": "base"},
    ]
    for goal in goals:
        controller = tsid(robot, goal=goal)
        assert controller.step(state_at(controller, values)).v < 1e-20


WRONG = {
    "two goals": ({"goal": {"posture": "neutral", "position_m": [0, 0, 0]}}, "goal"),
    "no goal": ({"goal": {}}, "goal"),
    "unknown posture": ({"goal": {"posture": "handstand"}}, "goal.posture"),
    "too few joints": ({"goal": {"posture_rad": [0.1, 0.2]}}, "goal.posture_rad"),
    "unknown reference": (
        {"goal": {"position_m": [0, 0, 1], "reference": "floor"}},
        "goal.reference",
    ),
    "a reference that moves": (
        {"goal": {"position_m": [0, 0, 1], "reference": "left_wrist"}},
        "goal.reference",
    ),
    "unknown frame": ({"frame": "left_paw"}, "frame"),
    "posture of the null space": ({"posture": {"posture": "handstand"}}, "posture.posture"),
    "against (11)": ({"bounds": {"horizon_periods": 100.0}}, "bounds"),
    "accelerations": ({"bounds": {"acceleration_max": [1.0, 2.0]}}, "bounds.acceleration_max"),
    "no weight": ({"posture": {"weight": 0.0}}, "posture.weight"),
}


@pytest.mark.parametrize("case", WRONG)
def test_settings_that_do_not_fit_are_refused_by_their_key(case):
    parameters, key = WRONG[case]
    with pytest.raises(ConfigError) as refused:
        tsid(baxter(), **parameters)
    assert refused.value.key == f"parameters.{key}"
