"""Centre of mass and zero-moment point inside the support polygon."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.constraint_bench import PERIOD, ROBOTS, Bench, hoap3, small

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.constraints.support.polygon import half_planes, hull, inset

SEEDS = st.integers(0, 2**32 - 1)
POLYGON = {"constraint": "support_polygon"}
ZMP = {"constraint": "zmp", "margin_m": 0.0}


def test_margins_are_distances_from_the_edges_less_the_margin():
    bench = Bench(hoap3(), {**POLYGON, "margin_m": 0.01, "reserve_m": 0.0})
    com = np.array([-0.0085, 0.0279])  # of the initial posture, in r_sole
    away = [0.0365 - com[1], com[0] + 0.054, com[1] + 0.0365, 0.054 - com[0]]
    np.testing.assert_allclose(sorted(bench.only.margins), sorted(np.array(away) - 0.01), atol=1e-9)
    assert bench.stack.margin() == pytest.approx(0.0365 - 0.0279 - 0.01)
    assert bench.only.events["started_outside"] == 1


def test_inside_u_0_is_allowed_and_the_rate_is_eta():
    bench = Bench(hoap3(), {**POLYGON, "eta_per_s": 5.0, "reserve_m": 1e-4})
    np.testing.assert_allclose(bench.stack.b, 5.0 * (bench.only.margins - 1e-4))
    assert (bench.stack.b > 0.0).all()


@pytest.mark.parametrize("edges", [[0], [1], [2], [3], [0, 1], [2, 3]], ids=str)
def test_pushed_outwards_the_centre_of_mass_stops_at_the_edge(edges):
    """Curvature takes at most cT² a step, which the reserve of 10 µm covers here."""
    bench = Bench(
        hoap3(),
        {"constraint": "joint_velocity", "limit_rad_s": 0.6},
        {"constraint": "joint_position"},
        {**POLYGON, "eta_per_s": 50.0},
    )
    outwards = bench.stack.A[edges].sum(axis=0)
    least = bench.walk(0.8 * outwards / np.abs(outwards).max(), 450, noise=0.1)
    assert least >= -1e-9
    assert bench.stack.constraints[2].margins[edges].max() < 2e-3  # it did come to the edges
    assert bench.stack.events() == {}


def test_from_outside_the_rows_lead_back_at_the_limited_rate():
    bench = Bench(
        hoap3(), {**POLYGON, "margin_m": 0.02, "eta_per_s": 20.0, "return_speed_m_s": 0.06}
    )
    first = bench.stack.margin()
    assert first == pytest.approx(0.0365 - 0.0279 - 0.02)
    assert bench.stack.b.min() == -0.06
    before = first
    for _ in range(300):
        bench.walk(np.zeros(bench.robot.n), 1)
        now = bench.stack.margin()
        assert now - before <= 0.06 * PERIOD + 1e-6
        before = now
    assert -5e-4 < now <= 0.0
    assert bench.only.events["started_outside"] == 1
    assert bench.only.events["outside"] >= 300


def test_where_no_joint_moves_the_margin_the_row_is_off_and_counted():
    bench = Bench(
        small(), {"constraint": "half_space", "frame": "base", "normal": [0, 0, 1], "offset_m": 1.0}
    )
    assert bench.stack.margin() == -1.0
    assert bench.stack.b[0] == np.inf
    assert not bench.stack.A.any()
    assert bench.only.events["immovable"] == 1


def test_both_soles_span_one_area():
    bench = Bench(hoap3(), {**POLYGON, "soles": ["r_sole", "l_sole"]})
    assert sum(np.isfinite(bench.only.margins)) == 4  # parallel soles: one rectangle
    assert bench.stack.margin() == pytest.approx(0.054 - 0.0085)  # y is inside by far now
    assert np.isinf(bench.stack.b[4:]).all()
    q = bench.robot.initial_position.copy()
    q[11] += 0.05
    bench.at(q)
    assert bench.only.events["sole_moved"] == 1


@settings(max_examples=30)
@given(seed=SEEDS, count=st.integers(3, 12))
def test_half_planes_hold_exactly_what_the_hull_holds(seed, count):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 2))
    corners = hull(points)
    normals, offsets = half_planes(corners)
    assert (points @ normals.T - offsets >= -1e-8).all()
    weights = rng.dirichlet(np.ones(len(corners)), 20)
    assert (weights @ corners @ normals.T - offsets >= -1e-12).all()
    for corner in corners:
        assert min(np.linalg.norm(points - corner, axis=1)) <= 1e-9


def test_hulls_of_rectangles_lose_corners_on_their_edges():
    rectangle = np.array([(0, 0), (2, 0), (2, 1), (0, 1), (1, 0), (1, 1), (0, 0), (1, 0.5)], float)
    np.testing.assert_array_equal(hull(rectangle), [(0, 0), (2, 0), (2, 1), (0, 1)])
    assert len(inset(hull(rectangle), 0.5 - 1e-9)) >= 3
    assert len(inset(hull(rectangle), 0.5 + 1e-9)) == 0


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({**POLYGON, "soles": ["r_sol"]}, "soles.*'r_sole'"),
        ({**POLYGON, "margin_m": 0.04}, "margin_m"),
        ({**ZMP, "margin_m": 0.0366}, "margin_m"),
    ],
)
def test_wrong_settings_are_named(entry, words):
    with pytest.raises(ConfigError, match=words):
        Bench(hoap3(), entry)


def test_a_larger_margin_fits_into_both_soles():
    Bench(hoap3(), {**POLYGON, "margin_m": 0.04, "soles": ["r_sole", "l_sole"]})


# the zero-moment point


def test_the_zmp_that_was_stays_inside_while_velocities_are_asked_for_that_would_throw_it_out():
    bench = Bench(hoap3(), {"constraint": "joint_velocity"}, ZMP, {**POLYGON, "margin_m": 0.001})
    zmp = bench.stack.constraints[1]
    least, tight = np.inf, 0
    q = bench.robot.initial_position.copy()
    for step in range(300):
        wanted = np.zeros(bench.robot.n)
        wanted[4] = 0.4 * np.sin(20.0 * step * PERIOD)
        q = q + PERIOD * bench.nearest(wanted)
        bench.at(q)
        least, tight = min(least, zmp.margin()), tight + (zmp.margin() < 1e-6)
    assert least >= -1e-9
    assert tight > 5  # the rows did bind
    assert zmp.events["outside"] == 0


def test_the_margin_is_that_of_second_differences_of_the_centre_of_mass():
    bench = Bench(hoap3(), ZMP)
    coms, heights, margins = [], [], []
    position, jacobian = np.zeros(3), np.zeros((3, bench.robot.n))
    frame = bench.kinematics.frame_id("r_sole")
    for step in range(60):
        q = bench.robot.initial_position.copy()
        q[4] += 1e-3 * np.sin(20.0 * step * PERIOD)
        q[5] += 1e-3 * (1.0 - np.cos(15.0 * step * PERIOD))
        bench.at(q)
        bench.kinematics.com(frame, position, jacobian)
        coms.append(position[:2].copy())
        heights.append(position[2])
        margins.append(bench.stack.margin())
    c = np.array(coms)
    normals, offsets = bench.only._area.normals, bench.only._area.offsets
    for k in range(3, 60):
        p = c[k - 1] - heights[k - 1] / 9.81 * (c[k] - 2 * c[k - 1] + c[k - 2]) / PERIOD**2
        assert (normals @ p - offsets).min() == pytest.approx(margins[k], abs=1e-5)


@pytest.mark.parametrize("name", ROBOTS)
@settings(max_examples=15)
@given(seed=SEEDS)
def test_zmp_rows_say_where_the_next_zmp_lies(name, seed):
    """Slack of each row, in metres of the ZMP, is the margin that the step then has."""
    robot, rng = ROBOTS[name](), np.random.default_rng(seed)
    bench = Bench(robot, ZMP)
    q = robot.initial_position + 0.1 * rng.normal(size=robot.n)
    bench.stack.reset()
    bench.at(q)
    u = 1e-3 * rng.normal(size=robot.n)
    bench.at(q + PERIOD * u)
    u = u + 1e-3 * rng.normal(size=robot.n)
    position = np.zeros(3)
    bench.kinematics.com(bench.only._area.frame, position, np.zeros((3, robot.n)))
    slack = (bench.stack.b - bench.stack.A @ u) * position[2] / (9.81 * PERIOD)
    bench.at(bench.state.reference + PERIOD * u)
    np.testing.assert_allclose(bench.only.margins, slack, atol=1e-9)


def test_a_missed_tick_is_counted_and_its_velocity_is_the_average():
    bench = Bench(small(), ZMP)
    q = small().initial_position
    step = PERIOD * np.array([0.1, 0.0, 0.0])
    tick = bench.state.tick
    bench.at(q + step, tick + 1)
    steady = bench.stack.b.copy()
    bench.at(q + 3 * step, tick + 3)
    assert bench.only.events["ticks_missed"] == 1
    np.testing.assert_allclose(bench.stack.b, steady, atol=1e-4)
    bench.stack.reset()
    bench.at(q)
    np.testing.assert_allclose(bench.only._speed, 0.0)


def test_the_same_tick_twice_changes_nothing():
    bench = Bench(small(), ZMP)
    q = small().initial_position
    bench.at(q + 1e-4, 8)
    first = bench.stack.b.copy(), bench.stack.margin()
    bench.at(q + 1e-4, 8)
    np.testing.assert_array_equal(bench.stack.b, first[0])
    assert bench.stack.margin() == first[1]
