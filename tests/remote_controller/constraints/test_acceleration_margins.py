"""Rows of accelerations of distances, balance, speeds and users' functions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.constraint_bench import (
    PERIOD,
    ROBOTS,
    AccelerationBench,
    Bench,
    hoap3,
    posture,
    small,
)

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.model.kinematics import Kinematics

SEEDS = st.integers(0, 2**32 - 1)
BALL = {"name": "ball", "shape": "sphere", "center_m": [0.25, 0.05, 0.35], "radius_m": 0.04}
ZMP = {"constraint": "zmp", "margin_m": 0.0}


def moved(robot, seed, speed=1.0):
    """Near the initial posture, moving."""
    rng, start = np.random.default_rng(seed), np.array(robot.initial_position)
    q = start + 0.3 * (posture(robot, seed) - start)
    return q, rng.normal(0.0, speed, robot.n), rng.normal(0.0, 5.0, robot.n)


def com_motion(robot, frame, q, dq, ddq, t=1e-4):
    """c and c̈ of the centre of mass along q + tq̇ + t²q̈/2, by differences."""
    kinematics, found = Kinematics(robot), []
    number = kinematics.frame_id(frame)
    for time in (-t, 0.0, t):
        kinematics.update(q + time * dq + 0.5 * time * time * ddq)
        found.append(np.zeros(3))
        kinematics.com(number, found[-1], np.zeros((3, robot.n)))
    behind, here, ahead = found
    return here, (ahead - 2.0 * here + behind) / t**2


@pytest.mark.parametrize("seed", range(6))
def test_pushed_at_a_ball_the_arm_stops_before_it(seed):
    bench = AccelerationBench(
        small(), {"constraint": "viability", "limit_rad_s": 1.5},
        {"constraint": "distance", "obstacles": [BALL], "activation_m": 0.3},
    )  # fmt: skip
    wanted, least = np.random.default_rng(seed).normal(0.0, 10.0, 3), np.inf
    bench.at(np.array([0.0, 0.3, 0.2]), np.zeros(3))
    assert bench.stack.margin() > 0.0
    for _ in range(2000):
        ddq = bench.nearest(wanted - 5.0 * bench.state.dq)
        if ddq is None:  # which is when a robot stops
            break
        bench.hold(ddq)
        least = min(least, bench.stack.margin())
    assert least >= -1e-9


@pytest.mark.parametrize("name", ROBOTS)
@settings(max_examples=15)
@given(seed=SEEDS)
def test_a_zmp_row_has_its_slack_times_gravity_over_height(name, seed):
    robot = ROBOTS[name]()
    bench = AccelerationBench(robot, ZMP)
    q, dq, ddq = moved(robot, seed)
    bench.at(q, dq)
    area = bench.only._area
    com, acceleration = com_motion(robot, robot.base_frame, q, dq, ddq)
    if com[2] < 1e-3:
        return
    on = np.isfinite(area.offsets)
    zmp = com[:2] - com[2] / 9.81 * acceleration[:2]
    slack = (bench.stack.rows_upper - bench.stack.rows @ ddq)[on] * com[2] / 9.81
    np.testing.assert_allclose(slack, (area.normals @ zmp - area.offsets)[on], atol=1e-4)


def test_the_zmp_that_was_stays_inside_while_more_is_asked_for():
    bench = AccelerationBench(
        hoap3(), {"constraint": "viability"}, ZMP, {"constraint": "support_polygon"}
    )
    zmp, tight = bench.stack.constraints[1], 0
    for step in range(300):
        wanted = np.zeros(21)
        wanted[4] = 8.0 * np.cos(20.0 * step * PERIOD)
        bench.hold(bench.nearest(wanted))
        tight += zmp.margin() < 1e-3
        assert zmp.margin() >= -1e-4  # c̈ is of the period's begin, the margin of all of it
    assert tight > 5


@pytest.mark.parametrize("name", ROBOTS)
@settings(max_examples=15)
@given(seed=SEEDS, mu=st.floats(0.1, 2.0), faces=st.integers(4, 12))
def test_what_the_pyramid_allows_is_in_the_cone(name, seed, mu, faces):
    robot = ROBOTS[name]()
    bench = AccelerationBench(robot, {"constraint": "friction_cone", "mu": mu, "faces": faces})
    q, dq, ddq = moved(robot, seed, speed=0.5)
    bench.at(q, 0.2 * dq)
    ddq = bench.nearest(30.0 * ddq)
    assert ddq is not None
    _, acceleration = com_motion(robot, robot.base_frame, q, 0.2 * dq, ddq)
    force = acceleration + np.array([0.0, 0.0, 9.81])
    assert np.hypot(force[0], force[1]) <= mu * force[2] + 1e-3
    slack = bench.stack.rows_upper - bench.stack.rows @ ddq
    angles = 2.0 * np.pi * np.arange(faces) / faces
    across = np.cos(angles) * force[0] + np.sin(angles) * force[1]
    expected = mu * np.cos(np.pi / faces) * force[2] - across
    np.testing.assert_allclose(slack, expected, atol=1e-3)


@settings(max_examples=15)
@given(seed=SEEDS)
def test_cones_of_velocities_say_what_the_next_force_will_be(seed):
    """Slack of each row over T is the margin that the step then has."""
    robot, rng = small(), np.random.default_rng(seed)
    bench = Bench(robot, {"constraint": "friction_cone"})
    q = robot.initial_position + 0.1 * rng.normal(size=robot.n)
    bench.stack.reset()
    bench.at(q)
    u = 1e-3 * rng.normal(size=robot.n)
    bench.at(q + PERIOD * u)
    u = u + 1e-3 * rng.normal(size=robot.n)
    slack = (bench.stack.b - bench.stack.A @ u) / PERIOD
    bench.at(bench.state.reference + PERIOD * u)
    np.testing.assert_allclose(bench.only.margins, slack, atol=1e-9)


def test_at_rest_the_whole_share_of_gravity_is_left():
    bench = AccelerationBench(hoap3(), {"constraint": "friction_cone", "mu": 0.3, "faces": 4})
    expected = 0.3 * np.cos(np.pi / 4.0) * 9.81
    np.testing.assert_allclose(bench.only.margins, expected)
    np.testing.assert_allclose(bench.stack.rows_upper, expected)


# speeds, functions


def test_a_least_speed_is_gathered_and_kept():
    joints = {"constraint": "minimum_speed", "joints": {"wrist": 2.0, "elbow": 1.0}, "speed": 0.3}
    bench = AccelerationBench(small(), {"constraint": "viability"}, joints)
    assert bench.stack.margin() == -0.3
    for _ in range(1000):
        bench.hold(bench.nearest(np.zeros(3)))
    dq = bench.state.dq
    assert dq[1] + 2.0 * dq[2] == pytest.approx(0.3, abs=1e-3)


@settings(max_examples=10)
@given(seed=SEEDS)
def test_a_frames_least_speed_counts_how_its_direction_turns(seed):
    bench = AccelerationBench(
        small(),
        {"constraint": "minimum_speed", "frame": "hand", "direction": [1, -2, 2], "speed": 0.1},
    )
    q, dq, ddq = moved(small(), seed)
    bench.at(q, dq)
    slack = float((bench.stack.rows_upper - bench.stack.rows @ ddq)[0])
    excess, t = bench.stack.margin(), 1e-5
    speeds = [bench.at(q + s * dq + 0.5 * s * s * ddq, dq + s * ddq).only.margins[0]
              for s in (-t, t)]  # fmt: skip
    assert slack == pytest.approx((speeds[1] - speeds[0]) / (2 * t) + 10.0 * excess, abs=1e-5)


def ring(q):
    """Joints within a ball: 4 − |q|² ≥ 0; and a wave."""
    return [4.0 - q @ q, 2.0 + np.sin(q).sum()], [-2.0 * q, np.cos(q)]


def moody(q):
    return ([1.0], [np.ones(3)]) if q[0] < 0.5 else ([np.nan], [np.ones(3)])


def short(q):
    return [1.0], [1.0, 2.0]


def test_a_function_gives_margins_at_both_levels():
    given_ = {"constraint": "user_function", "function": f"{__name__}:ring", "reserve_m": 0.0}
    q, dq, ddq = moved(small(), 3)
    bench = Bench(small(), given_).at(q)
    m, slopes = ring(q)
    np.testing.assert_allclose(bench.only.margins, m)
    np.testing.assert_allclose(bench.stack.A, -np.array(slopes))
    np.testing.assert_allclose(bench.stack.b, 10.0 * np.array(m))
    fast = AccelerationBench(small(), {**given_, "eta_per_s": 2.0}).at(q, dq)
    slack = (fast.stack.rows_upper - fast.stack.rows @ ddq)[0]
    expected = -2.0 * (dq @ dq + q @ ddq) - 8.0 * q @ dq + 4.0 * m[0]
    assert slack == pytest.approx(expected, abs=1e-6)


def test_a_bad_value_is_counted_and_nothing_is_certified():
    bench = AccelerationBench(
        small(), {"constraint": "user_function", "function": f"{__name__}:moody"}
    )
    assert bench.stack.margin() == 1.0
    bench.at(np.array([1.0, 0.0, 0.0]), np.ones(3))
    assert bench.stack.margin() == -np.inf
    assert not bench.stack.rows.any()
    assert np.isposinf(bench.stack.rows_upper).all()
    assert bench.only.events["bad_value"] == 1


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"constraint": "user_function", "function": f"{__name__}:short"}, "function.*short"),
        ({"constraint": "user_function", "function": "numpy"}, "function: .*numpy"),
        ({"constraint": "friction_cone", "sole": "hand"}, "sole: .*hand"),
    ],
)
def test_wrong_settings_are_named(entry, words):
    for bench in (Bench, AccelerationBench):
        with pytest.raises(ConfigError, match=words):
            bench(small(), entry)


def test_torques_are_refused_where_velocities_are_asked_for():
    with pytest.raises(ConfigError, match="joint_torque"):
        Bench(small(), {"constraint": "joint_torque"})


def test_more_constraints_than_have_a_bit_are_refused():
    entries = [{"constraint": "joint_velocity"}] * 64
    AccelerationBench(small(), *entries[:63])
    with pytest.raises(ConfigError, match=r"parameters\.constraints: .*64.*63"):
        AccelerationBench(small(), *entries)
