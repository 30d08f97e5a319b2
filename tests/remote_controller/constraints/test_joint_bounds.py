"""Bounds on joint speed and joint position."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.constraint_bench import PERIOD, ROBOTS, Bench, hoap3, small

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.constraints.limit_kernels import limit_rows, narrow_to_range

SEEDS = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("name", ROBOTS)
@settings(max_examples=30)
@given(seed=SEEDS, eta=st.floats(0.1, 1.0 / PERIOD))
def test_random_speeds_cut_to_the_bounds_never_leave_the_range(name, seed, eta):
    robot, rng = ROBOTS[name](), np.random.default_rng(seed)
    bench = Bench(robot, {"constraint": "joint_position", "eta_per_s": eta})
    q = rng.uniform(robot.lower, robot.upper)
    for _ in range(20):
        bench.at(q)
        u = np.clip(rng.normal(0.0, 1000.0, robot.n), bench.stack.lower, bench.stack.upper)
        q = q + PERIOD * u
        assert bench.stack.margin() >= -1e-9
    assert bench.stack.events() == {}


def test_a_rate_that_oversteps_is_refused_with_the_largest_that_does_not():
    with pytest.raises(
        ConfigError, match=r"constraints\.0\.parameters\.eta_per_s.* 1000\b"
    ) as caught:
        Bench(hoap3(), {"constraint": "joint_position", "eta_per_s": 1000.1})
    assert caught.value.value == 1000.1
    Bench(hoap3(), {"constraint": "joint_position", "eta_per_s": 1000.0})


@pytest.mark.parametrize("kind", ["support_polygon", "distance", "fixed_frame", "half_space"])
def test_every_rate_is_refused_so(kind):
    more = {
        "fixed_frame": {"frame": "l_sole"},
        "half_space": {"frame": "head", "normal": [0, 0, 1]},
    }
    with pytest.raises(ConfigError, match="eta_per_s"):
        Bench(hoap3(), {"constraint": kind, "eta_per_s": 2000.0, **more.get(kind, {})})


def test_outside_a_joint_returns_at_the_limited_rate_and_is_counted():
    bench = Bench(
        small(),
        {"constraint": "joint_position", "eta_per_s": 10.0, "return_speed_rad_s": 0.2},
        {"constraint": "joint_velocity"},
    )
    bench.stack.reset()
    bench.at(np.array([2.05, -2.08, 0.0]))
    np.testing.assert_allclose(bench.stack.upper, [-0.2, 3.0, 3.0])
    np.testing.assert_allclose(bench.stack.lower, [-3.0, 0.2, -3.0])
    assert bench.stack.margin() == pytest.approx(-0.08)
    assert bench.stack.tightest() == "joint_position: elbow lower"
    events = {"joint_position: outside": 1, "joint_position: started_outside": 1}
    assert bench.stack.events() == events
    bench.at(np.array([2.01, 0.0, 0.0]))
    assert bench.stack.upper[0] == pytest.approx(-0.1)
    assert bench.stack.events() == {**events, "joint_position: outside": 2}


@pytest.mark.parametrize("order", [1, -1])
def test_the_return_is_never_faster_than_the_speed_limit(order):
    entries = [
        {"constraint": "joint_position", "return_speed_rad_s": 0.5, "eta_per_s": 100.0},
        {"constraint": "joint_velocity", "joints_rad_s": {"shoulder": 0.1, "elbow": 0.0}},
    ][::order]
    bench = Bench(small(), *entries).at(np.array([2.1, -2.1, 2.1]))
    np.testing.assert_allclose(bench.stack.lower, [-0.1, 0.0, -3.0])
    np.testing.assert_allclose(bench.stack.upper, [-0.1, 0.0, -0.5])


def test_speeds_are_the_least_of_robot_common_and_own_limit():
    bench = Bench(
        small(),
        {"constraint": "joint_velocity", "limit_rad_s": 1.0, "joints_rad_s": {"wrist": 9.0}},
    )
    np.testing.assert_array_equal(bench.stack.upper, [1.0, 1.0, 3.0])
    np.testing.assert_array_equal(bench.stack.lower, [-1.0, -1.0, -3.0])
    assert bench.stack.margin() == np.inf
    assert bench.stack.A.shape == (0, 3)


def test_what_is_not_named_is_not_bound():
    bench = Bench(small(), {"constraint": "joint_position", "joints": ["elbow"]})
    assert list(np.isfinite(bench.stack.lower)) == [False, True, False]


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"constraint": "joint_position", "joints": ["elbo"]}, "joints.*'elbow'"),
        ({"constraint": "joint_position", "margin_rad": 2.5}, "margin_rad.*'shoulder'.* 2"),
        ({"constraint": "joint_velocity", "joints_rad_s": {"hip": 1.0}}, "joints_rad_s.*hip"),
        ({"constraint": "joint_velocity", "joints_rad_s": {"elbow": -1.0}}, "elbow: "),
    ],
)
def test_wrong_settings_are_named(entry, words):
    with pytest.raises(ConfigError, match=words):
        Bench(small(), entry)


def test_a_margin_that_is_no_number_is_never_the_smallest_good_one():
    margins, b = np.array([np.nan, 0.5]), np.zeros(2)
    assert np.isnan(limit_rows(margins, 10.0, 0.0, 1.0, np.eye(2), b)[0])
    ends, margins = np.array([1.0, 1.0]), np.zeros(4)
    least = narrow_to_range(
        np.array([np.nan, 0.0]), -ends, ends, 1.0, 1.0, margins, -ends, ends.copy()
    )
    assert np.isnan(least)
