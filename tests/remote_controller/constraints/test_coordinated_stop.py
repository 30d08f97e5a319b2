"""Whether a robot can stop in time, against looks at thousands of postures."""

from __future__ import annotations

import numpy as np
import pytest
from support.constraint_bench import PERIOD, AccelerationBench, hoap3, posture, small
from support.robots.following_arm import following

from hoap3.remote_controller.constraints.coordinated_stop import STOP_RESERVE, reach
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.robots.yaml_file import RobotFile, describe

BALL = {"name": "ball", "shape": "sphere", "center_m": [0.25, 0.05, 0.35], "radius_m": 0.04}
DISTANCE = {"constraint": "distance", "obstacles": [BALL], "activation_m": 0.3}
FLOOR = {"constraint": "half_space", "frame": "hand", "normal": [0, 0, 1], "offset_m": 0.45}
POLYGON = {"constraint": "support_polygon"}
RING = {"constraint": "user_function", "function": f"{__name__}:ring", "steepest": 8.0}
LOW_TIP = {"constraint": "half_space", "frame": "tip", "normal": [0, 0, 1], "offset_m": 0.55}
BESIDE = {
    "constraint": "distance",
    "pairs": [["left", "right"]],
    "obstacles": [{**BALL, "center_m": [0.3, 0.35, 0.6], "radius_m": 0.1}],
    "clearance_m": 0.0,
    "activation_m": 0.3,
}
CASES = {
    "half_space": (small, FLOOR),
    "distance": (small, DISTANCE),
    "user_function": (small, RING),
    "support_polygon": (hoap3, POLYGON),
    "all": (small, FLOOR, DISTANCE, RING),
    "followers": (following, LOW_TIP, BESIDE),
}


def ring(q):
    return [4.0 - q @ q], [-2.0 * q]


def on_the_way(bench, q, dq, looks=2000):
    """All conditional margins along the stop, (looks, margins), and in the end."""
    robot = bench.robot
    brake = np.minimum(robot.brake_acceleration, robot.setpoint_acceleration_max)
    time = np.ceil(np.max(np.abs(dq) / brake) / PERIOD - 1e-9) * PERIOD
    kinematics, found = Kinematics(robot), []
    for frame in robot.frames:
        kinematics.frame_id(frame)
    for s in np.linspace(0.0, 1.0, looks):
        kinematics.update(q + s * 0.5 * time * dq)
        row = []
        for each in bench.stack.constraints:
            if each.guarantee != "conditional":
                continue
            margins = np.zeros(each.margins.size)
            each.margins_at(kinematics, margins)
            row.append(margins)
        found.append(np.concatenate(row))
    return np.array(found)


@pytest.mark.parametrize("case", CASES)
def test_a_stop_that_is_called_safe_is(case):
    robot, *entries = CASES[case]
    bench, rng = AccelerationBench(robot(), *entries), np.random.default_rng(4)
    safe = unsafe = needlessly = 0
    for seed in range(40):
        share = rng.uniform(0.0, 0.5)
        start = np.array(robot().initial_position)
        q = start + share * (posture(robot(), seed) - start)
        dq = rng.uniform(1.0, 25.0) * rng.uniform(-1.0, 1.0, robot().n)
        bench.at(q, dq)
        if bench.stack.margin() < 0.0:
            continue
        told = bench.stack.stop_is_safe(q, dq)
        least = on_the_way(bench, q, dq, 500).min()
        if told:
            assert least >= -STOP_RESERVE
        else:
            needlessly += least > 1e-3
        safe, unsafe = safe + told, unsafe + (not told)
    assert safe > 0
    assert unsafe > 0
    assert needlessly <= 1 + unsafe // 3


def test_far_from_everything_nothing_is_looked_at():
    bench = AccelerationBench(small(), {**FLOOR, "offset_m": -3.0})
    q = bench.state.q.copy()
    assert bench.stack.stop_is_safe(q, np.full(3, 2.0))
    assert bench.stack._stop.looks == 0
    margin = bench.stack.margin() - 3.45  # of a floor at 0.45 m
    bench = AccelerationBench(small(), {**FLOOR, "offset_m": 0.45 + margin - 1e-3})
    assert bench.stack.margin() == pytest.approx(1e-3)
    up = -bench.stack.rows[0]
    assert bench.stack.stop_is_safe(q, 3.0 * up / np.abs(up).max())
    assert 0 < bench.stack._stop.looks < 20


def test_looking_ahead_counts_no_events_and_leaves_the_margins():
    bench = AccelerationBench(small(), FLOOR, DISTANCE, RING)
    q, dq = np.array([0.0, 0.9, 0.6]), np.array([0.5, 1.5, 1.0])
    bench.at(q, dq)
    events, margins = bench.stack.events(), [c.margins.copy() for c in bench.stack.constraints]
    rows, upper = bench.stack.rows.copy(), bench.stack.rows_upper.copy()
    bench.stack.stop_is_safe(q + 0.5, 20.0 * dq)
    assert bench.stack._stop.looks > 0
    assert bench.stack.events() == events
    np.testing.assert_array_equal(bench.stack.rows, rows)
    np.testing.assert_array_equal(bench.stack.rows_upper, upper)
    for constraint, kept in zip(bench.stack.constraints, margins, strict=True):
        np.testing.assert_array_equal(constraint.margins, kept)


def test_what_is_outside_may_come_back_and_not_go_further_out():
    bench = AccelerationBench(small(), {**FLOOR, "offset_m": 0.6})
    q = np.array([0.0, 1.0, 0.5])
    bench.at(q, np.zeros(3))
    assert bench.stack.margin() < -0.05
    assert bench.stack.stop_is_safe(q, np.zeros(3))
    assert bench.stack.stop_is_safe(q, np.array([0.0, -1.0, -0.5]))
    assert not bench.stack.stop_is_safe(q, np.array([0.0, 1.0, 0.5]))


def unknown(q):
    return ([1.0], [np.zeros(3)]) if q[0] < 0.5 else ([np.nan], [np.zeros(3)])


def test_a_margin_that_nobody_knows_is_not_safe():
    entry = {"constraint": "user_function", "function": f"{__name__}:unknown"}
    bench = AccelerationBench(small(), entry)
    q = np.array([1.0, 0.0, 0.0])
    bench.at(q, np.ones(3))
    assert not bench.stack.stop_is_safe(q, np.ones(3))


def test_without_conditional_constraints_every_stop_is_safe():
    for entries in ((), ({"constraint": "viability"},)):
        assert AccelerationBench(small(), *entries).stack.stop_is_safe(np.zeros(3), np.ones(3))


@pytest.mark.parametrize("robot", [small, hoap3])
def test_no_two_frames_come_to_be_further_apart_than_the_reach(robot):
    kinematics = Kinematics(robot())
    most, farthest = reach(kinematics), 0.0
    for seed in range(200):
        kinematics.update(posture(robot(), seed))
        origins = kinematics.frames()[0]
        farthest = max(farthest, np.linalg.norm(origins[:, None] - origins[None], axis=2).max())
    assert farthest <= most + 1e-12
    assert farthest > 0.3 * most


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_robot_that_stops_where_it_must_never_hits_the_ball(seed):
    """Pushed at it as fast as it goes, with the stop from the next state judged each tick."""
    bench = AccelerationBench(small(), {"constraint": "viability"}, DISTANCE)
    robot = bench.robot
    brake = np.minimum(robot.brake_acceleration, robot.setpoint_acceleration_max)
    wanted, stops = np.random.default_rng(seed).normal(0.0, 40.0, 3), 0
    bench.at(np.array([0.0, 0.3, 0.2]), np.zeros(3))
    for _ in range(1500):
        q, dq = bench.state.q.copy(), bench.state.dq.copy()
        ddq = bench.nearest(wanted - 5.0 * dq)
        ahead = (
            None if ddq is None else (q + PERIOD * dq + 0.5 * PERIOD**2 * ddq, dq + PERIOD * ddq)
        )
        if ahead is None or not bench.stack.stop_is_safe(*ahead):
            time = max(np.ceil(np.max(np.abs(dq) / brake) / PERIOD - 1e-9), 1.0) * PERIOD
            ddq, stops = np.clip(-dq / time, bench.stack.lower, bench.stack.upper), stops + 1
        bench.hold(ddq)
        assert bench.stack.margin() >= -STOP_RESERVE


def crank(ratio: float):
    """A slide that turns an arm of half a metre by `ratio` [rad/m], with a ball at its end."""
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    shape = '<collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.05"/></geometry>'
    limit = '<limit lower="-9" upper="9" velocity="90" effort="9"/>'
    urdf = (
        f'<robot name="crank"><link name="root"/><link name="slide">{mass}</inertial></link>'
        f'<link name="arm">{mass}</inertial>{shape}</collision></link>'
        f'<joint name="drive" type="prismatic"><parent link="root"/><child link="slide"/>{limit}'
        '<axis xyz="0 0 1"/></joint>'
        f'<joint name="turn" type="revolute"><parent link="slide"/><child link="arm"/>{limit}'
        f'<axis xyz="0 0 1"/><mimic joint="drive" multiplier="{ratio}"/></joint></robot>'
    )
    return describe(RobotFile(name="crank", urdf="crank.urdf", brake_acceleration=40.0), urdf)


@pytest.mark.parametrize("ratio", [20.0, -20.0])
def test_a_mimic_joint_that_goes_further_than_its_mimicked_joint_is_looked_at(ratio):
    """The slide stops within 10 cm, and meanwhile the arm turns through a ball 1 rad ahead."""
    ahead = [0.5 * np.cos(1.0), np.sign(ratio) * 0.5 * np.sin(1.0), 0.05]
    ball = {**BALL, "center_m": ahead, "radius_m": 0.05}
    entry = {**DISTANCE, "obstacles": [ball], "clearance_m": 0.0, "activation_m": 0.3}
    bench = AccelerationBench(crank(ratio), entry)
    q, dq = np.zeros(1), np.array([np.sqrt(2.0 * 40.0 * 0.1)])
    bench.at(q, dq)
    assert bench.stack.margin() > 0.3
    assert on_the_way(bench, q, dq).min() < -0.05
    assert not bench.stack.stop_is_safe(q, dq)
    assert bench.stack.stop_is_safe(q, 0.1 * dq)
