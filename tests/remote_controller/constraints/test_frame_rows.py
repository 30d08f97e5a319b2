"""Frames kept still or in a half-space, least speeds, Pfaffian rows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.constraint_bench import (
    PERIOD,
    Bench,
    StatedDrift,
    hoap3,
    posture,
    small,
)

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.constraints.frames.fixed_frame import AXES

SEEDS = st.integers(0, 2**32 - 1)
HEAD = {"constraint": "half_space", "frame": "head", "normal": [1.0, 2.0, -0.5]}
HAND = {"constraint": "half_space", "frame": "hand", "normal": [0.3, -1.0, 2.0]}
PINNED = {"constraint": "fixed_frame", "frame": "l_sole"}


def test_a_half_space_margin_is_the_distance_from_the_plane_of_any_normal():
    """At q = 0 the hand of the small arm is 0.6 m above the base, a point of it 0.7 m."""
    plane = {"constraint": "half_space", "frame": "hand", "normal": [0, 0, -5], "offset_m": -0.75}
    bench = Bench(small(), {**plane, "point_m": [0.0, 0.0, 0.1]}).at(np.zeros(3))
    assert bench.stack.margin() == pytest.approx(0.75 - 0.7)


@pytest.mark.parametrize("seed", range(4))
def test_pushed_through_the_plane_a_point_stops_at_it(seed):
    bench = Bench(
        small(),
        {"constraint": "joint_velocity", "limit_rad_s": 1.0},
        {**HAND, "normal": [0.0, 0.0, 1.0], "offset_m": 0.45, "eta_per_s": 50.0},
    )
    wanted = np.random.default_rng(seed).normal(0.0, 1.0, 3)
    assert bench.walk(wanted, 1000) >= -1e-9


@settings(max_examples=8)
@given(seed=SEEDS, eta=st.floats(5.0, 500.0))
def test_without_a_reserve_curvature_takes_no_more_than_was_said(seed, eta):
    """m ≥ −cT/η − cT², c measured as what each step lost beyond its first order, over T²."""
    bench = Bench(
        small(),
        {"constraint": "joint_velocity", "limit_rad_s": 2.0},
        {**HAND, "normal": [0, 0, 1], "offset_m": 0.5, "eta_per_s": eta, "reserve_m": 0.0},
    )
    wanted = np.zeros(3)
    rng, curvature, least = np.random.default_rng(seed), 0.0, np.inf
    for step in range(150):
        wanted = rng.normal(0.0, 2.0, 3) if step % 25 == 0 else wanted
        u = bench.nearest(wanted)
        before = bench.stack.margin() - PERIOD * float(bench.stack.A[0] @ u)
        bench.at(bench.state.reference + PERIOD * u)
        curvature = max(curvature, abs(bench.stack.margin() - before) / PERIOD**2)
        least = min(least, bench.stack.margin())
    assert least >= -curvature * (PERIOD / eta + PERIOD**2) - 1e-12


def test_a_start_on_the_plane_allows_every_motion_away_and_none_through():
    bench = Bench(small(), {**HAND, "normal": [0.0, 0.0, 1.0]})
    height = bench.stack.margin()
    bench = Bench(small(), {**HAND, "normal": [0.0, 0.0, 1.0], "offset_m": height})
    assert abs(bench.stack.margin()) < 1e-15
    assert abs(bench.stack.b[0]) < 1e-15
    assert bench.stack.events() == {}


def test_a_pinned_foot_stays_while_the_rest_moves():
    bench = Bench(hoap3(), {"constraint": "joint_velocity", "limit_rad_s": 0.5}, PINNED)
    rng = np.random.default_rng(5)
    start = bench.robot.initial_position
    bench.walk(rng.normal(0.0, 0.3, 21), 300)
    assert bench.stack.drift() < 2e-5  # T/(2η) times its acceleration
    assert np.abs(bench.state.reference - start).max() > 0.05
    assert bench.stack.constraints[1].events["outside"] == 0


@pytest.mark.parametrize("axes", [("rz",), ("x", "ry")])
@settings(max_examples=5)
@given(seed=SEEDS, eta=st.floats(2.0, 1000.0))
@pytest.mark.slow
def test_a_frame_that_turns_freely_drifts_no_further_than_is_stated(axes, seed, eta):
    """ω on the axes that are kept would not do: ω_z = 0 allows turns that end up about z."""
    bench = Bench(
        hoap3(),
        {"constraint": "joint_velocity", "limit_rad_s": 2.0},
        {**PINNED, "axes": axes, "eta_per_s": eta},
    )
    rng, wanted, q = np.random.default_rng(seed), np.zeros(21), bench.state.reference.copy()
    stated = StatedDrift(hoap3(), "l_sole", hoap3().base_frame, axes, eta, 2, q)
    for step in range(400):
        wanted = rng.normal(0.0, 1.0, 21) if step % 50 == 0 else wanted
        u = bench.nearest(wanted)
        stated.move(q, u)
        q = q + PERIOD * u
        assert bench.at(q).stack.drift() == pytest.approx(stated.drift(q), abs=1e-12)
        assert bench.stack.drift() <= stated.most


def test_drift_is_taken_back_at_the_rate():
    bench = Bench(hoap3(), {**PINNED, "eta_per_s": 20.0})
    q = bench.robot.initial_position.copy()
    stated = StatedDrift(hoap3(), "l_sole", hoap3().base_frame, AXES, 20.0, 2, q)
    q[11] += 0.01
    bench.at(q)
    assert bench.stack.drift() == pytest.approx(stated.drift(q), abs=1e-12)
    assert bench.stack.drift() > 1e-3
    assert np.abs(bench.stack.c).max() == 20.0 * bench.stack.drift()
    bench.walk(np.zeros(21), 400)
    assert bench.stack.drift() < 1e-5
    assert bench.stack.margin() == np.inf


def test_only_the_chosen_axes_are_kept():
    bench = Bench(hoap3(), {**PINNED, "axes": ["z", "rx", "z"]})
    assert bench.stack.C.shape == (2, 21)
    assert bench.stack.equality_names == ("fixed_frame: l_sole z", "fixed_frame: l_sole rx")
    assert bench.stack.names == ()


# least speeds


def test_a_least_speed_is_accepted_only_where_it_is_orthogonal_to_the_gradient():
    bench = Bench(
        small(),
        {"constraint": "minimum_speed", "joints": {"wrist": 2.0, "elbow": 1.0}, "speed": 0.3},
    )
    np.testing.assert_array_equal(bench.stack.A, [[0.0, -1.0, -2.0]])
    np.testing.assert_array_equal(bench.stack.b, [-0.3])
    assert bench.stack.reject(np.array([5.0, -2.0, 1.0])) == ""
    assert bench.stack.reject(np.zeros(3)) == ""
    assert bench.stack.b[0] == -0.3
    assert bench.stack.reject(np.array([0.0, 1.0, -0.4])) == "minimum_speed"
    assert bench.stack.b[0] == np.inf
    assert not bench.stack.A.any()
    assert bench.stack.events() == {"minimum_speed: not_orthogonal": 1}


def test_the_judgement_does_not_depend_on_scale():
    bench = Bench(small(), {"constraint": "minimum_speed", "joints": {"wrist": 1.0}, "speed": 1.0})
    for scale in (1e-12, 1.0, 1e12):
        assert bench.only.accepts(scale * np.array([1.0, 1.0, 1e-8]))
        assert not bench.only.accepts(scale * np.array([1.0, 1.0, 1e-4]))


@settings(max_examples=10)
@given(seed=SEEDS)
def test_a_frames_least_speed_is_that_of_its_origin(seed):
    toward = np.array([1.0, -2.0, 2.0]) / 3.0
    bench = Bench(
        small(),
        {"constraint": "minimum_speed", "frame": "hand", "direction": [1, -2, 2], "speed": 0.1},
    )
    q, position = posture(small(), seed), np.zeros(3)
    u = np.random.default_rng(seed).normal(size=3)
    speed = -float(bench.at(q).stack.A[0] @ u)
    heights = []
    for side in (1e-6, -1e-6):
        bench.kinematics.update(q + side * u)
        frames = (bench.kinematics.frame_id(name) for name in ("hand", "base"))
        bench.kinematics.frame(*frames, position, np.zeros((3, 3)), np.zeros((6, 3)))
        heights.append(toward @ position)
    assert speed == pytest.approx((heights[0] - heights[1]) / 2e-6, abs=1e-7)


def test_where_nothing_moves_the_frame_the_least_speed_is_off_and_counted():
    bench = Bench(
        small(),
        {"constraint": "minimum_speed", "frame": "base", "direction": [1, 0, 0], "speed": 0.1},
    )
    assert bench.stack.b[0] == np.inf
    assert bench.stack.events() == {"minimum_speed: no_direction": 1}


# Pfaffian rows


def rolling(q: FloatArray) -> FloatArray:
    return np.array([[np.sin(q[0]), -np.cos(q[0]), 0.0], [0.0, q[1], 1.0]])


def moody(q: FloatArray) -> object:
    return [[1.0, np.nan, 0.0]] if q[0] > 1.0 else ([[1.0]] if q[0] < -1.0 else [[q[0], 1.0, 2.0]])


def test_a_function_gives_the_rows():
    bench = Bench(small(), {"constraint": "pfaffian", "function": f"{__name__}:rolling"})
    q = posture(small(), 3)
    np.testing.assert_array_equal(bench.at(q).stack.C, rolling(q))
    assert not bench.stack.c.any()
    u = bench.nearest(np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(bench.stack.C @ u, 0.0, atol=1e-9)


def test_a_bad_matrix_is_counted_and_the_last_good_one_stays():
    bench = Bench(small(), {"constraint": "pfaffian", "function": f"{__name__}:moody"})
    for shoulder in (0.5, 1.5, -1.5):
        bench.at(np.array([shoulder, 0.0, 0.0]))
        np.testing.assert_array_equal(bench.stack.C, [[0.5, 1.0, 2.0]])
    assert bench.stack.events() == {"pfaffian: bad_matrix": 2}


def test_a_constant_matrix_gives_the_rows():
    bench = Bench(small(), {"constraint": "pfaffian", "matrix": [[1, 0, -1]]})
    np.testing.assert_array_equal(bench.at(posture(small(), 1)).stack.C, [[1.0, 0.0, -1.0]])
    bench.walk(np.array([0.3, 0.0, 0.0]), 10)
    moved = bench.state.reference - posture(small(), 1)
    assert moved[0] == pytest.approx(moved[2], abs=1e-9)
    assert moved[0] == pytest.approx(0.15 * 10 * PERIOD, abs=1e-9)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({**HEAD, "normal": [0, 0, 0]}, "normal: "),
        ({**HEAD, "frame": "hed"}, r"constraints\.0\.parameters\.frame: .*'hed'"),
        ({**HEAD, "reference": "floor"}, r"constraints\.0\.parameters\.reference: .*floor"),
        ({"constraint": "minimum_speed", "speed": 1.0}, "direction"),
        ({"constraint": "minimum_speed", "speed": 1.0, "frame": "head"}, "direction: "),
        ({"constraint": "minimum_speed", "speed": 1.0, "joints": {"r_knee": 0.0}}, "joints: "),
        ({"constraint": "pfaffian"}, "matrix.*function"),
        ({"constraint": "pfaffian", "matrix": [[1, 2]]}, r"matrix: .*\(1, 2\).*21"),
        ({"constraint": "pfaffian", "matrix": [[1, 2], [1]]}, "matrix: "),
        ({"constraint": "pfaffian", "function": "numpy"}, "function: .*numpy"),
        ({"constraint": "pfaffian", "function": "nowhere:f"}, "function: .*nowhere"),
        ({"constraint": "pfaffian", "function": "math:pi"}, "function: .*math:pi"),
        ({"constraint": "pfaffian", "function": "numpy:ones_like"}, r"\(21,\)"),
    ],
)
def test_wrong_settings_are_named(entry, words):
    with pytest.raises(ConfigError, match=words):
        Bench(hoap3(), entry)
