"""Stationary postures are left by a bounded motion along which V falls, where one exists."""

from __future__ import annotations

import numpy as np
import pytest
from support.checked_answers import check_answers
from test_progress import began, controller, outcome, urdf

import hoap3
from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.config import ControllerConfig, build
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.controllers.singularity import (
    ATTEMPTS,
    LEAVING,
    OF_RANGE,
    REACH,
    SPEED,
    SingularityExit,
)
from hoap3.robot_emulator.robots import load
from hoap3.tools.analysis.replay import replay_records
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import ControllerRun, runs
from hoap3.tools.verify.leaving import check_leaving
from hoap3.tools.verify.statements import check_engagements

ONE_POINT = ("qp12", "pinv", "osqp")
EVERY = (*ONE_POINT, "stable_qp", "clik", "clik_sdp", "ghc_velocity")
LENGTH, INWARDS = 0.3, 0.01
ARM = np.array([3 * LENGTH, 0.0, 0.0])
# at posture 0: point, frame that it is seen from, its position, and the direction of the stretch
STRETCHED = {
    "planar": ("tip", "base", ARM, ARM / np.linalg.norm(ARM)),
    "lwr": ("ee", "base", np.array([0.0, 0.0, 1.1785]), np.array([0.0, 0.0, 1.0])),
    "ur5": (
        "wrist_1_link",
        "base",
        np.array([-0.81725, -0.10915, 0.089159]),
        np.array([-0.81725, -0.10915, 0.0]) / np.hypot(0.81725, 0.10915),
    ),
    # knee at the end of its range
    "humanoid32": (
        "r_ankle",
        "pelvis",
        np.array([0.0, -0.09, -0.8562]),
        np.array([0.0, 0.0, -1.0]),
    ),
}


@pytest.fixture
def planar(tmp_path):
    file = tmp_path / "planar.urdf"
    file.write_text(urdf())
    return str(file)


def pair(robot: str, name: str, planar: str, by: float, **more: object) -> tuple[dict, dict]:
    """A stretched robot, and a controller whose target lies `by` further in."""
    point, frame, place, direction = STRETCHED[robot]
    target = [float(x) for x in place - by * direction]
    emulator = {"robot": planar} if robot == "planar" else {"robot": robot, "posture": "zero"}
    if name in ONE_POINT:
        parameters = {"point": point, "reference_frame": frame, "target_m": target, **more}
        return emulator, {"controller": name, "parameters": parameters}
    goal = {"kind": "point", "position_m": target}
    given = {"frame": point, "reference": frame, "target": goal}
    if robot == "planar":
        given["axes"] = ["x", "y"]
    task = {"task": "frame_position", "parameters": given}
    parameters = {"task": task} if name == "stable_qp" else {"tasks": [task]}
    return emulator, {"controller": name, "parameters": {**parameters, **more}}


def leave(robot: str, name: str, planar: str, by: float = INWARDS, duration: float = 0.5):
    emulator, law = pair(robot, name, planar, by, leave_singularity=True)
    return hoap3.simulate(emulator, law, duration=duration), law


def log_of(run: hoap3.Simulation) -> ControllerRun:
    (found,) = runs(run.records)
    return found


def check_limits(run: hoap3.Simulation) -> None:
    """Position, speed and acceleration of what the robot applies, at each tick."""
    robot, T = log_of(run).description, log_of(run).description.period_s
    applied = run.states["reference"]
    assert (applied >= robot.lower - 1e-12).all()
    assert (applied <= robot.upper + 1e-12).all()
    speed = np.diff(applied, axis=0) / T
    assert (np.abs(speed) <= robot.velocity * (1 + 1e-9)).all()
    most = robot.setpoint_acceleration_max * (1 + 1e-6)
    assert (np.abs(np.diff(speed, axis=0, prepend=0.0)) / T <= most).all()


def check_motion(run: hoap3.Simulation) -> np.ndarray:
    """The motion itself: within its own bounds, applied as it was sent, certifying nothing."""
    log = log_of(run)
    leaving = log.during(LEAVING)
    answers, robot = run.setpoints[leaving], log.description
    assert set(answers["solver_status"]) == {STATUS["uncertified"]}
    places = np.flatnonzero(leaving)
    after = run.states["reference"][places + 1]
    np.testing.assert_array_equal(after, answers["values"])
    assert (np.abs(answers["decision"]) <= SPEED * robot.velocity * (1 + 1e-12)).all()
    reach = np.minimum(REACH, OF_RANGE * (robot.upper - robot.lower))
    assert (np.abs(after - run.states["reference"][0]) <= reach + 1e-3).all()
    return leaving


def check_log(run: hoap3.Simulation, law: dict) -> None:
    """Verify finds nothing false, and a replay gives the same bytes."""
    claims = Claims()
    log = log_of(run)
    check_leaving(log, law["parameters"], claims)
    leaving = log.during(LEAVING)
    assert leaving.any()
    found = check_answers(run.records, law["controller"], law["parameters"])
    assert found.checked or leaving.all()
    assert found.listed == claims.listed == []
    limits = claims.counts["leaving: limits"]
    assert limits.checked == 2 * log.description.n * np.count_nonzero(leaving)
    replayed = replay_records(run.records, parse(ControllerConfig, law, "config"))
    assert replayed.passed
    assert replayed.setpoints == len(run.setpoints)


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize(
    "robot",
    [
        "planar",
        *(pytest.param(each, marks=pytest.mark.slow) for each in STRETCHED if each != "planar"),
    ],
)
def test_a_stretched_robot_is_left_and_comes_nearer(robot, name, planar):
    emulator, law = pair(robot, name, planar, INWARDS)
    still = hoap3.simulate(emulator, law, duration=0.3)
    assert LEAVING not in began(still)
    if (robot, name) != ("ur5", "ghc_velocity"):  # which rounding moves away by itself
        assert still.setpoints["v"].min() >= 4.999e-5
    run, law = leave(robot, name, planar)
    assert LEAVING in began(run)
    leaving = check_motion(run)
    check_limits(run)
    check_log(run, law)
    V = run.setpoints["v"]
    assert V[0] == pytest.approx(0.5 * INWARDS**2)
    after = V[np.flatnonzero(leaving)[-1] + 1 :]
    assert after[0] < 0.999 * V[0]
    assert after[-1] < 0.99 * after[0]  # the controller goes on by itself
    again, _ = leave(robot, name, planar)
    np.testing.assert_array_equal(again.setpoints["values"], run.setpoints["values"])


@pytest.mark.parametrize(
    ("field", "change", "claim"),
    [
        ("solver_status", lambda _: STATUS["certified"], "leaving: status"),
        ("v_rate_predicted", lambda rate: rate - 1e-3, "leaving: no certificate"),
        ("values", lambda values: values + 1e-9, "setpoint"),
        ("decision", lambda u: u + 0.05, "leaving: limits"),
    ],
)
def test_a_changed_answer_is_found(field, change, claim, planar):
    run, law = leave("planar", "clik", planar, duration=0.2)
    records = list(run.records)
    place = [i for i, each in enumerate(records) if each.kind == Kind.SETPOINT][100]
    answer = Setpoint.like(records[place].payload)
    answer.load(records[place].payload)
    if field in {"values", "decision"}:
        getattr(answer, field)[:] = change(getattr(answer, field))
    else:
        setattr(answer, field, change(getattr(answer, field)))
    records[place] = records[place]._replace(payload=answer.dump())
    claims = Claims()
    (log,) = runs(records)
    check_leaving(log, law["parameters"], claims)
    assert claim in {each.claim for each in claims.listed}


def test_the_certificate_of_an_answer_that_is_not_finite_is_counted_once(planar):
    run, law = leave("planar", "clik", planar, duration=0.2)
    records = list(run.records)
    place = [i for i, each in enumerate(records) if each.kind == Kind.SETPOINT][100]
    answer = Setpoint.like(records[place].payload)
    answer.load(records[place].payload)
    answer.values[0] = np.nan
    records[place] = records[place]._replace(payload=answer.dump())
    claims = Claims()
    (log,) = runs(records)

    check_leaving(log, law["parameters"], claims)
    check_engagements(records, law["controller"], law["parameters"], claims)

    leaving = np.count_nonzero(log.during(LEAVING))
    assert sum(claims.counts["certificate"].unverified.values()) == leaving
    assert sum(claims.counts["leaving: limits"].unverified.values()) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "duration"),
    [("clik", 3.0), ("clik_sdp", 3.0), ("ghc_velocity", 3.0), ("qp12", 12.0), ("stable_qp", 12.0)],
)
def test_the_target_is_reached(name, duration, planar):
    run, _ = leave("planar", name, planar, duration=duration)
    judged = outcome(run)
    assert judged["task"]["errors"][0]["within"]
    assert judged["verdicts"]["task"] == "pass" or duration < 6.0  # the motion takes its share


@pytest.mark.parametrize("name", EVERY)
def test_a_target_out_of_reach_leaves_nothing_to_leave(name, planar):
    run, _ = leave("planar", name, planar, by=-INWARDS, duration=0.1)
    assert not np.abs(run.states["reference"]).any()
    assert outcome(run)["task"]["errors"][0]["reason"] == "stationary: x of base"
    assert log_of(run).during(LEAVING).sum() == 2  # of three ticks that determine the Hessian


@pytest.mark.parametrize("name", EVERY)
def test_the_direction_is_that_of_negative_curvature_towards_the_middle(name, planar):
    run, _ = leave("planar", name, planar, duration=0.2)
    # tip x = Σ L cos(q1 + … + qi): at 0 its Hessian is −L·Σ_i≥max(j,k), that of y is 0
    J = LENGTH * np.array([[0.0, 0.0, 0.0], [3.0, 2.0, 1.0]])
    second = -LENGTH * np.array([[3.0, 2.0, 1.0], [2.0, 2.0, 1.0], [1.0, 1.0, 1.0]])
    values, vectors = np.linalg.eigh(J.T @ J + INWARDS * second)
    falling = vectors[:, values < 0.0]
    assert falling.shape[1] == 2
    d = falling @ falling.T @ np.ones(3)  # all joints are at the middle of their ranges
    wanted = d / np.abs(d).max() * SPEED * 2.0
    np.testing.assert_allclose(run.setpoints["decision"][100], wanted, atol=1e-4)


@pytest.mark.parametrize("name", EVERY)
def test_it_is_off_by_default(name, planar):
    emulator, law = pair("planar", name, planar, INWARDS)
    off = hoap3.simulate(emulator, law, duration=0.02)
    explicit = pair("planar", name, planar, INWARDS, leave_singularity=False)[1]
    same = hoap3.simulate(emulator, explicit, duration=0.02)
    assert off.setpoints["values"].tobytes() == same.setpoints["values"].tobytes()
    assert LEAVING not in off.controller.conditions


def state_of(robot, tick: int) -> State:
    state = State.allocate(**robot.state_lengths)
    state.tick = tick
    return state


def test_attempts_at_one_point_are_few_and_go_both_ways():
    robot = load("ur5")
    unbounded = np.full(robot.n, np.inf)
    H = np.diag([1.0, 1.0, -0.1, 1.0, 1.0, 1.0])
    made = SingularityExit(robot, (-unbounded, unbounded), lambda q, _: H @ q)
    zero, ways, moving, ticks = np.zeros(robot.n), [], 0, 20_000
    for tick in range(ticks):  # the robot does not follow
        active = made.advance(state_of(robot, tick), zero, 1.0, still=True)
        moving += active
        if active and made.u[2] and (not ways or np.sign(made.u[2]) != ways[-1]):
            ways.append(float(np.sign(made.u[2])))
    assert ways == [1.0, -1.0, 1.0]
    assert len(ways) == ATTEMPTS
    assert moving < ticks // 2
    # another point, as where the target has moved
    assert made.advance(state_of(robot, ticks), zero, 2.0, still=True)
    for tick in range(ticks + 1, 2 * ticks):
        active = made.advance(state_of(robot, tick), zero, 2.0, still=True)
    assert not active
    made.reset()
    assert made.advance(state_of(robot, 2 * ticks), zero, 2.0, still=True)


def test_a_state_that_comes_again_gets_the_same_answer(planar):
    emulator, law = pair("planar", "clik", planar, INWARDS, leave_singularity=True)
    run = hoap3.simulate(emulator, law, duration=0.1)
    description = log_of(run).description
    built = build(parse(ControllerConfig, law, "config"), description)
    for row, answer in zip(run.states[:90], run.setpoints, strict=False):
        state = State.allocate(**description.state_lengths)
        state.load(row.tobytes())
        if state.tick == 0:
            built.reset(state, None)
        for _ in range(2):
            np.testing.assert_array_equal(built.step(state).values, answer["values"])


def test_rows_of_constraints_are_refused(planar):
    sphere = {"constraint": "fixed_frame", "parameters": {"frame": "tip", "axes": ["y"]}}
    more = {"leave_singularity": True, "constraints": [sphere]}
    emulator, law = pair("planar", "stable_qp", planar, INWARDS, **more)
    with pytest.raises(ConfigError, match=r"parameters\.leave_singularity"):
        hoap3.simulate(emulator, law, duration=0.01)


def test_bounds_of_joints_are_kept(planar):
    slow = {"constraint": "joint_velocity", "parameters": {"limit_rad_s": 0.02}}
    more = {"leave_singularity": True, "constraints": [slow]}
    emulator, law = pair("planar", "stable_qp", planar, INWARDS, **more)
    run = hoap3.simulate(emulator, law, duration=0.3)
    check_log(run, law)
    assert np.abs(run.setpoints["decision"]).max() == pytest.approx(0.02)


@pytest.mark.parametrize("name", ["tsid", "weighted", "ghc", "hqp", "joint_acceleration"])
def test_other_controllers_refuse_the_key(name, planar):
    content = controller(name, 0.89, leave_singularity=True)
    content["parameters"]["leave_singularity"] = True
    with pytest.raises(ConfigError, match=r"leave_singularity"):
        hoap3.simulate(planar, content, duration=0.01)


def test_no_bounds_block_ghc_velocity_next_to_a_singularity(planar):
    """Where no joint is at a bound, regularisation alone makes it slow."""
    emulator, law = pair("planar", "ghc_velocity", planar, INWARDS)
    description = log_of(hoap3.simulate(emulator, law, duration=0.01)).description
    built = build(parse(ControllerConfig, law, "config"), description)
    state = State.allocate(**description.state_lengths)
    state.q[:] = state.reference[:] = [0.0, 2e-6, 0.0]
    for tick in range(300):
        state.tick = tick
        if tick == 0:
            built.reset(state, None)
        built.step(state)
        names = [each for i, each in enumerate(built.conditions) if built.present >> i & 1]
        assert not [each for each in names if each.startswith("blocked")], names
