"""Rows and bounds of joint accelerations."""

from __future__ import annotations

import numpy as np
import pytest
from support import HOUSE
from support.constraint_bench import (
    PERIOD,
    ROBOTS,
    ROUNDING,
    AccelerationBench,
    Bench,
    StatedDrift,
    hoap3,
    posture,
    small,
)

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.constraints.barrier import Barrier
from hoap3.remote_controller.constraints.constraint import Constraint
from hoap3.remote_controller.constraints.frames.fixed_frame import AXES
from hoap3.remote_controller.constraints.registry import BUILTIN, find

FLOOR = {"constraint": "half_space", "frame": "hand", "normal": [0, 0, 1], "offset_m": 0.45}
GENTLE = {"constraint": "joint_velocity", "limit_rad_s": 1.0}


class Wave(Barrier):
    """A user's own: one method, and only that."""

    def __init__(self, parameters, description, kinematics, period_s):
        super().__init__(parameters, description, kinematics, period_s)
        self.name_rows(("wave", "sum"))
        self.q = np.zeros(description.n)
        self.looks = 0

    def look(self, kinematics, margins_out, A_out):
        self.looks += 1
        kinematics.joints(self.q)
        margins_out[:] = 2.0 + np.sin(self.q).sum(), 3.0 - self.q @ self.q / 2.0
        A_out[0], A_out[1] = -np.cos(self.q), self.q


class Old(Barrier):
    """Written for velocities, before there was anything else."""

    def update(self, kinematics, state, A_out, b_out):
        self.limit(A_out, b_out)


def moved(robot, seed, speed=1.0):
    return posture(robot, seed), np.random.default_rng(seed).normal(0.0, speed, robot.n)


def test_a_users_one_method_serves_both_levels_and_only_looks():
    bench = AccelerationBench(small(), {"constraint": f"{__name__}:Wave"})
    q, dq = moved(small(), 1)
    bench.only.looks = 0
    outside = bench.at(q, 0.0 * dq).only.events["outside"]
    assert bench.only.looks == 1
    assert bench.at(q, dq).only.looks == 4  # once there, and to either side for the curvature
    assert bench.only.events["outside"] == outside == 0


def test_the_class_of_the_docs_serves_accelerations_as_it_stands(tmp_path, monkeypatch):
    text = (HOUSE / "docs" / "guides" / "extending.md").read_text(encoding="utf-8")
    code = text.partition("<!-- file: least_height.py -->\n```python\n")[2].partition("```")[0]
    (tmp_path / "least_height_twice.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    bench = AccelerationBench(
        hoap3(), {"constraint": "viability", "limit_rad_s": 1.0},
        {"constraint": "least_height_twice:LeastHeight", "height_m": 0.28},
    )  # fmt: skip
    wanted, least = np.zeros(21), np.inf
    wanted[[2, 3, 4]] = -10.0, 20.0, -10.0
    for _ in range(1500):
        bench.hold(bench.nearest(wanted - 5.0 * bench.state.dq))
        least = min(least, bench.stack.margin())
    assert least >= -1e-9
    assert bench.stack.constraints[1].margins[0] < 2e-3  # it did go down to there


class Blind(Wave):
    """Says that it holds while the robot can stop, and cannot say what is on the way."""

    def margins_at(self, kinematics, out):
        raise NotImplementedError


class Empty(Wave):
    def update_accelerations(self, motion, state, G_out, lower_out, upper_out):
        lower_out[:], upper_out[:] = 1.0, -1.0


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("Blind", "NotImplementedError"),
        ("Empty", r"lower_out\[0\].* 1\.0"),
        ("Old", "Old'.*look.*update"),
    ],
)
def test_what_gives_no_rows_of_accelerations_is_refused(kind, words):
    with pytest.raises(ConfigError, match=words) as raised:
        AccelerationBench(small(), {"constraint": f"{__name__}:{kind}"})
    assert raised.value.key == "parameters.constraints.0.constraint"


@pytest.mark.parametrize("name", sorted(BUILTIN))
def test_each_of_ours_says_what_it_serves_and_what_it_guarantees(name):
    found = find(name)
    assert found.levels
    assert next(each for each in found.__mro__ if "guarantee" in vars(each)) is not Constraint


@pytest.mark.parametrize("seed", range(4))
def test_pushed_through_the_plane_a_point_stops_at_it(seed):
    bench = AccelerationBench(small(), {"constraint": "viability", "limit_rad_s": 1.0}, FLOOR)
    wanted, least, nearest = np.random.default_rng(seed).normal(0.0, 20.0, 3), np.inf, np.inf
    for _ in range(3000):
        bench.hold(bench.nearest(wanted - 5.0 * bench.state.dq))
        least = min(least, bench.stack.margin())
        nearest = min(nearest, float(bench.stack.constraints[1].margins[0]))
    assert least >= -1e-9
    assert nearest < 0.15
    assert bench.stack.events() == {}


def test_from_outside_the_rows_lead_back_no_faster_than_asked():
    bench = AccelerationBench(
        small(), {"constraint": "viability"}, {**FLOOR, "eta_per_s": 4.0, "offset_m": 0.4}
    )
    q = np.array([0.0, 2.0, 0.0])
    bench.at(q, np.zeros(3))
    plane = bench.stack.constraints[1]
    assert plane.margins[0] < -0.05
    before, fastest = float(plane.margins[0]), 0.0
    for _ in range(7000):
        bench.hold(bench.nearest(-2.0 * bench.state.dq))
        fastest, before = max(fastest, float(plane.margins[0]) - before), float(plane.margins[0])
    assert fastest <= 0.05 * PERIOD
    assert -5e-4 < before < 1e-2
    assert plane.events["outside"] > 1000


# rates


def test_a_rate_that_is_set_must_fit_the_period_and_the_brakes():
    slow = {"constraint": "joint_velocity", "limit_rad_s": 0.01}
    with pytest.raises(ConfigError, match="600") as raised:
        AccelerationBench(small(), slow, {**FLOOR, "eta_per_s": 601.0})
    assert raised.value.key.endswith("constraints.1.parameters.eta_per_s")
    with pytest.raises(ConfigError, match=r"'shoulder' .*13\.3"):
        AccelerationBench(small(), {**FLOOR, "eta_per_s": 601.0})
    head = {"constraint": "half_space", "frame": "head", "normal": [0, 0, 1]}
    with pytest.raises(ConfigError, match=r"eta_per_s: .*'r_hip_yaw'.*4\.76.*40.*8\.4"):
        AccelerationBench(hoap3(), {**head, "eta_per_s": 9.0})
    AccelerationBench(hoap3(), {"constraint": "joint_velocity", "limit_rad_s": 2.0},
                      {**head, "eta_per_s": 9.0})  # fmt: skip


def test_the_default_rate_is_lowered_to_what_the_joints_brake_with():
    head = {"constraint": "half_space", "frame": "head", "normal": [0, 0, 1]}
    bench = AccelerationBench(hoap3(), head)
    assert bench.only._eta == pytest.approx(40.0 / 4.76)
    bench = AccelerationBench(hoap3(), head, {"constraint": "joint_acceleration",
                                              "limit_rad_s2": 4.76})  # fmt: skip
    assert bench.only._eta == pytest.approx(1.0)
    bench = AccelerationBench(hoap3(), head, {**GENTLE})
    assert bench.only._eta == 10.0


# equations


def test_a_pinned_foot_stays_while_the_rest_moves():
    bench = AccelerationBench(hoap3(), {"constraint": "viability", "limit_rad_s": 1.0},
                              {"constraint": "fixed_frame", "frame": "l_sole"})  # fmt: skip
    wanted = np.random.default_rng(5).normal(0.0, 5.0, 21)
    start = bench.robot.initial_position
    for _ in range(300):
        bench.hold(bench.nearest(wanted - 5.0 * bench.state.dq))
        assert bench.stack.drift() < 1e-6  # T/(2η²) times its jerk
    assert np.abs(bench.state.q - start).max() > 0.05
    np.testing.assert_array_equal(bench.stack.rows_lower, bench.stack.rows_upper)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("seed", range(3))
def test_fixed_rows_are_what_the_frame_accelerates_by(name, seed):
    robot, rng = ROBOTS[name](), np.random.default_rng(seed)
    frame = {"hoap3": "l_forearm", "small": "hand"}[name]
    kept = {"constraint": "fixed_frame", "frame": frame}
    bench = AccelerationBench(robot, {**kept, "eta_per_s": 0.0})
    still = Bench(robot, {**kept, "eta_per_s": 1.0})  # whose right side is −e
    for each in (bench, still):
        each.stack.reset()
    bench.at(posture(robot, seed), np.zeros(robot.n))  # what is kept is any other pose
    still.at(posture(robot, seed))
    q, dq, ddq = posture(robot, seed + 9), *rng.normal(size=(2, robot.n))
    bench.at(q, dq)
    expected = bench.stack.rows @ ddq - bench.stack.rows_upper
    near = [q + t * dq + 0.5 * t * t * ddq for t in (-1e-4, 0.0, 1e-4)]
    errors = [-still.at(each).stack.c for each in near]
    np.testing.assert_allclose(np.diff(errors, 2, axis=0)[0] / 1e-8, expected, atol=1e-6)


@pytest.mark.parametrize("axes", [pytest.param(("rz",), marks=pytest.mark.slow), ("x", "ry"), AXES])
@pytest.mark.parametrize("eta", [2.0, pytest.param(20.0, marks=pytest.mark.slow), 600.0])
def test_a_fixed_frame_drifts_no_further_than_is_stated(axes, eta):
    """Also where it turns freely about the other axes, and long after its start."""
    pinned = {"constraint": "fixed_frame", "frame": "l_sole", "axes": axes, "eta_per_s": eta}
    bench = AccelerationBench(hoap3(), {"constraint": "viability", "limit_rad_s": 1.0}, pinned)
    rng, wanted, state = np.random.default_rng(3), np.zeros(21), bench.state
    stated = StatedDrift(hoap3(), "l_sole", hoap3().base_frame, axes, eta, 3, state.q)
    for step in range(1000):
        wanted = rng.normal(0.0, 3.0, 21) if step % 50 == 0 else wanted
        ddq = bench.nearest(wanted - 5.0 * state.dq)
        stated.move(state.q, state.dq, ddq)
        assert bench.hold(ddq).stack.drift() == pytest.approx(stated.drift(state.q), abs=1e-12)
        assert bench.stack.drift() <= stated.most


def test_drift_of_a_frame_is_taken_back_at_the_rate():
    pinned = {"constraint": "fixed_frame", "frame": "l_sole", "eta_per_s": 20.0}
    bench = AccelerationBench(hoap3(), pinned)
    q = bench.robot.initial_position.copy()
    q[11] += 0.01
    bench.at(q, np.zeros(21))
    first = bench.stack.drift()
    assert first > 1e-3
    for _ in range(500):
        bench.hold(bench.nearest(np.zeros(21)))
    assert bench.stack.drift() < 1.1 * 11.0 * np.exp(-10.0) * first  # (1 + ηt)e^(−ηt)


def rolling(q):
    return np.array([[np.sin(q[0]), -np.cos(q[0]), 0.0], [0.0, q[1], 1.0]])


def test_a_pfaffian_equation_holds_along_a_motion():
    rows = {"constraint": "pfaffian", "function": f"{__name__}:rolling"}
    bench = AccelerationBench(small(), {"constraint": "viability", "limit_rad_s": 1.0}, rows)
    c, state = 0.0, bench.state
    for _ in range(800):
        ddq = bench.nearest(np.array([3.0, 0.0, 0.0]) - 2.0 * state.dq)
        speeds = []
        for t in (0.0, PERIOD / 2, PERIOD):
            q, dq = state.q + t * state.dq + t * t / 2 * ddq, state.dq + t * ddq
            speeds.append(rolling(q) @ dq)
        c = max(c, np.abs(np.diff(speeds, 2, axis=0)).max() / (PERIOD / 2) ** 2)
        bench.hold(ddq)
        assert bench.stack.drift() <= (c * PERIOD / 2 + ROUNDING) / 10.0  # η
    assert np.abs(bench.state.dq).max() > 0.1


# joints


@pytest.mark.parametrize("kind", ["viability", "joint_position"])
@pytest.mark.parametrize("name", ROBOTS)
def test_random_accelerations_within_the_bounds_never_leave_the_range(name, kind):
    robot, rng = ROBOTS[name](), np.random.default_rng(3)
    bench = AccelerationBench(robot, {"constraint": kind})
    push = np.zeros(robot.n)
    for tick in range(3000):
        push = rng.normal(0.0, 100.0, robot.n) if tick % 300 == 0 else push
        bench.hold(np.clip(push, bench.stack.lower, bench.stack.upper))
        assert bench.stack.margin() >= -1e-9
    if kind == "viability":
        assert (np.abs(bench.state.dq) <= robot.velocity + 1e-9).all()
    assert bench.stack.events() == {}


def test_speeds_are_kept_by_accelerations_and_what_is_faster_brakes():
    bench = AccelerationBench(small(), {"constraint": "joint_velocity", "limit_rad_s": 1.0})
    brake = np.minimum(small().brake_acceleration, small().setpoint_acceleration_max)
    bench.at(np.zeros(3), np.array([1.0, -0.999, 2.9]))
    np.testing.assert_allclose(bench.stack.upper, [0.0, 1999.0, -brake[2]], atol=1e-9)
    np.testing.assert_allclose(bench.stack.lower[:2], [-2000.0, -1.0], atol=1e-9)


def test_accelerations_come_first_whatever_the_order():
    entries = [{"constraint": "joint_velocity", "limit_rad_s": 1.0},
               {"constraint": "joint_acceleration", "limit_rad_s2": 2.0}]  # fmt: skip
    for order in (1, -1):
        bench = AccelerationBench(small(), *entries[::order])
        bench.at(np.zeros(3), np.array([2.0, 0.0, 0.0]))
        np.testing.assert_array_equal(bench.stack.upper, [-2.0, 2.0, 2.0])
        np.testing.assert_array_equal(bench.stack.lower, [-2.0, -2.0, -2.0])


def test_torques_are_bounded_by_the_least_of_all_limits():
    bench = AccelerationBench(small(), {"constraint": "joint_torque", "limit_nm": 1e9},
                              {"constraint": "joint_torque",
                               "joints_nm": {"elbow": 0.5}})  # fmt: skip
    expected = np.array(small().effort)
    expected[1] = 0.5
    np.testing.assert_array_equal(bench.stack.torque_max, expected)
    assert np.isposinf(bench.stack.upper).all()


def test_nothing_at_all_is_a_stack_too():
    stack = AccelerationBench(small()).stack
    assert stack.rows.shape == (0, 3)
    assert stack.margin() == np.inf
    assert stack.tightest() == ""
    assert np.isneginf(stack.lower).all()
    assert np.isposinf(stack.torque_max).all()


def test_limits_against_condition_11_are_refused_by_joint():
    with pytest.raises(ConfigError, match=r"0\.parameters: .*shoulder.*\(11\)"):
        AccelerationBench(small(), {"constraint": "viability", "limit_rad_s": 1e-3})
