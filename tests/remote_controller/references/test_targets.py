"""Targets: velocity is the derivative of position, curves close, and nothing starts with a jump."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter

from hoap3.remote_controller.references.settings import TargetSettings
from hoap3.remote_controller.references.spline import Spline
from hoap3.remote_controller.references.target import Approach, Point, Target
from hoap3.remote_controller.references.waypoints import Waypoints

START = np.array([0.11, -0.07, 0.31])
CENTER = [0.1, 0.0, 0.3]
ROWS = "t,x,y,z\n0,0,0,0.3\n0.5,0.1,0,0.3\n1.2,0.1,0.2,0.25\n2,0,0.1,0.2\n2.5,0,0,0.3\n"
POINTS = [[0.1, 0.0, 0.2], [0.1, 0.1, 0.2], [0.1, 0.1, 0.2], [0.0, 0.1, 0.3]]
EVERY = {
    "point": {"kind": "point", "position_m": CENTER, "approach_s": 1.0},
    "quintic": {"kind": "waypoints", "points_m": POINTS[:2], "times_s": [1.0, 1.5]},
    "trapezoid": {
        "kind": "waypoints",
        "points_m": POINTS,
        "speed_m_s": 0.3,
        "profile": "trapezoid",
    },
    "circle": {"kind": "circle", "center_m": CENTER, "radius_m": 0.05, "period_s": 2.0},
    "circle at once": {
        "kind": "circle",
        "center_m": CENTER,
        "radius_m": 0.05,
        "period_s": 2.0,
        "plane": "zx",
        "direction": "backward",
        "start_rad": 0.3,
        "approach_s": 0.0,
    },
    "lemniscate": {
        "kind": "lemniscate",
        "center_m": CENTER,
        "half_width_m": 0.1,
        "period_s": 3.0,
        "plane": "yz",
        "approach_s": 0.7,
    },
    "spline": {"kind": "spline", "file": "path.csv"},
    "closed spline": {"kind": "spline", "file": "path.csv", "repeat": True, "approach_s": 0.4},
    "cubic": {"kind": "trajectory", "file": "path.csv", "interpolation": "cubic"},
    "quintic later": {
        "kind": "trajectory",
        "csv": ROWS.replace("\n0,", "\n0.4,"),
        "interpolation": "quintic",
        "time_scaling": 1.3,
    },
}
STEP = 1e-6  # s


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("targets")
    (path / "path.csv").write_text(ROWS)
    return path


def made(name: str, folder: Path) -> Target:
    settings = TypeAdapter(TargetSettings).validate_python(EVERY[name])
    return settings.build(folder)


def at(target: Target, time_s: float) -> tuple[np.ndarray, np.ndarray]:
    out = np.full(target.dimension, np.nan), np.full(target.dimension, np.nan)
    target.at(time_s, *out)
    return out


@pytest.mark.parametrize("name", EVERY)
@settings(max_examples=30)
@given(begin=st.sampled_from([0.0, 12.345]), time_s=st.floats(1e-5, 8.0))
def test_velocity_is_the_derivative_of_position(name, folder, begin, time_s):
    target = made(name, folder)
    target.start(START, begin)
    (behind, _), (_, velocity), (ahead, _) = (
        at(target, begin + time_s + shift) for shift in (-STEP, 0.0, STEP)
    )
    # in a corner of a trapezoid the acceleration jumps: its share of a step remains
    np.testing.assert_allclose(velocity, (ahead - behind) / (2 * STEP), rtol=0, atol=2e-5)


@pytest.mark.parametrize("name", EVERY)
def test_position_and_velocity_are_continuous(name, folder):
    """Between ticks of 1 ms, over every seam, neither changes by more than its rate allows."""
    target = made(name, folder)
    target.start(START, 0.0)
    path = [at(target, 0.001 * tick) for tick in range(8000)]
    position, velocity = (np.array(each) for each in zip(*path, strict=True))
    fastest = np.max(np.linalg.norm(velocity, axis=1))
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    assert steps.max() <= 0.001 * fastest * 1.01
    assert np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() < 0.02


@pytest.mark.parametrize("name", [name for name in EVERY if name != "circle at once"])
def test_it_starts_at_rest_where_the_robot_is(name, folder):
    target = made(name, folder)
    for begin in (0.0, 77.7):  # and again, after a hand-over
        target.start(START, begin)
        position, velocity = at(target, begin)
        np.testing.assert_allclose(position, START, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(velocity, 0.0)


def test_without_an_approach_it_starts_on_the_curve(folder):
    target = made("circle at once", folder)
    target.start(START, 5.0)
    position, velocity = at(target, 5.0)
    expected = [0.1 + 0.05 * np.sin(0.3), 0.0, 0.3 + 0.05 * np.cos(0.3)]
    np.testing.assert_allclose(position, expected, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(velocity), 0.05 * np.pi, rtol=1e-12)
    assert velocity[0] < 0.0  # backwards: from the second axis (x) towards the first (z)


@pytest.mark.parametrize(("name", "period"), [("circle", 2.0), ("lemniscate", 3.0)])
def test_curves_close(name, period, folder):
    target = made(name, folder)
    target.start(START, 0.0)
    for time_s in np.linspace(1.0, 4.0, 17):
        for here, later in zip(at(target, time_s), at(target, time_s + 2 * period), strict=True):
            np.testing.assert_allclose(later, here, rtol=0, atol=1e-13)


def test_a_circle_is_round_and_a_lemniscate_is_bernoullis(folder):
    center, a = np.array(CENTER), 0.1
    for name in ("circle", "lemniscate"):
        target = made(name, folder)
        target.start(START, 0.0)
        for time_s in np.linspace(1.0, 5.0, 29):
            away = at(target, time_s)[0] - center
            if name == "circle":
                assert np.linalg.norm(away) == pytest.approx(0.05, rel=1e-12)
                assert away[2] == 0.0
            else:
                x, y = away[1], away[2]
                assert (x * x + y * y) ** 2 == pytest.approx(a * a * (x * x - y * y), abs=1e-16)
                assert away[0] == 0.0


def test_a_closed_spline_closes_and_an_open_one_rests_at_both_ends(folder):
    closed, opened = made("closed spline", folder), made("spline", folder)
    for target in (closed, opened):
        target.start(START, 0.0)
    for time_s in (0.6, 1.1, 2.4):
        for here, later in zip(at(closed, time_s), at(closed, time_s + 5.0), strict=True):
            np.testing.assert_allclose(later, here, rtol=0, atol=1e-13)
    position, velocity = at(opened, 100.0)
    np.testing.assert_array_equal(position, [0.0, 0.0, 0.3])
    np.testing.assert_array_equal(velocity, 0.0)
    seam = [at(closed, 5.0 + shift)[1] for shift in (-1e-9, 1e-9)]
    np.testing.assert_allclose(*seam, atol=1e-7)
    assert np.linalg.norm(seam[0]) > 0.05  # it does not stop there


@settings(max_examples=40)
@given(
    widths=st.lists(st.floats(0.05, 2.0), min_size=1, max_size=8),
    seed=st.integers(0, 2**32 - 1),
    repeats=st.booleans(),
)
def test_a_spline_goes_through_its_points_with_continuous_acceleration(widths, seed, repeats):
    times = np.concatenate([[0.0], np.cumsum(widths)])
    points = np.random.default_rng(seed).normal(size=(len(times), 3))
    if repeats:
        points[-1] = points[0]
    spline = Spline(times, points, repeats)
    for time, point in zip(times, points, strict=True):
        np.testing.assert_allclose(at(spline, time)[0], point, rtol=0, atol=1e-9)

    def acceleration(time):
        return (at(spline, time + 1e-6)[1] - at(spline, time - 1e-6)[1]) / 2e-6

    scale = 20.0 * np.max(np.abs(points)) / min(widths) ** 2
    for time in [*times[1:-1], *([times[-1]] if repeats else [])]:
        jump = acceleration(time + 3e-6) - acceleration(time - 3e-6)
        np.testing.assert_allclose(jump, 0.0, atol=1e-3 * scale)


def test_waypoints_are_reached_in_time_and_no_faster_than_said():
    points = np.array(POINTS)
    timed = Waypoints(points[:2], times_s=[1.0, 1.5])
    timed.start(START, 0.0)
    for time, point in ((1.0, points[0]), (1.5, points[1]), (9.0, points[1])):
        np.testing.assert_allclose(at(timed, time)[0], point, atol=1e-15)
        np.testing.assert_array_equal(at(timed, time)[1], 0.0)
    for profile in ("quintic", "trapezoid"):
        target = Waypoints(points, speed=0.3, profile=profile)
        target.start(START, 0.0)
        speeds = [np.linalg.norm(at(target, t)[1]) for t in np.linspace(0.0, 3.0, 6001)]
        assert max(speeds) == pytest.approx(0.3, rel=1e-3)


def test_before_its_start_a_target_stays():
    target = Approach(Point(np.ones(3)), 1.0)
    target.start(START, 10.0)
    np.testing.assert_array_equal(at(target, 9.0)[0], START)
