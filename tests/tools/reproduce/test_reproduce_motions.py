"""Motions within constraints: rows pass on a good motion, and each fails on one that is not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up import TICKS, failed, good_run

from hoap3.remote_controller.constraints.collision.collision_geometry import links
from hoap3.remote_controller.controllers.base import STATUS
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.papers.qp12 import certified, circulation, obstacle, oracle, support
from hoap3.tools.reproduce.papers.qp12.circulation import Circulation, Ellipse
from hoap3.tools.reproduce.papers.qp12.obstacle import ROUND, THROUGH, Obstacle, Passage
from hoap3.tools.reproduce.papers.qp12.support import CONDITION, Support

pytestmark = pytest.mark.slow

T = 1e-3
ELLIPSE = Ellipse((0.0, 0.02, 0.285), (0.015, 0.01), 0.1)
"""As the shipped one, and ten times as fast: once round in 0.8 s."""


def drop(array, tick, value):
    changed = array.copy()
    changed[tick] = value
    return changed


def test_what_holds_for_every_motion():
    run = good_run()
    assert failed([certified.falls("x", run), *certified.certified("x", run)]) == []
    bad = {
        "V rises": {"v": drop(run.v, 500, 2e-4)},
        "without a certificate": {"status": drop(run.status, 7, STATUS["uncertified"])},
        "smallest margin": {"margin": drop(run.margin, 7, -1e-8)},
    }
    for words, changes in bad.items():
        other = good_run(**changes)
        items = failed([certified.falls("x", other), *certified.certified("x", other)])
        assert len(items) == 1, words
        assert words in items[0]


def test_rounding_of_v_is_no_rise():
    run = good_run(v=np.full(TICKS, 5e-4) + 1e-18 * np.arange(TICKS))
    assert np.ptp(run.v) > 0.0
    assert run.rises == 0


def test_a_run_is_what_the_controller_said():
    content = certified.config("stable_qp_hoap3")
    run = certified.run(content, 0.05)
    assert len(run.v) == len(run.q) == len(run.time_s) == 50
    np.testing.assert_allclose(run.required, -run.rho * run.psi)
    np.testing.assert_allclose(run.given, run.required, rtol=1e-9)
    np.testing.assert_allclose(np.diff(run.v) / T, run.given[:-1], rtol=0.02)
    assert run.error[0] == pytest.approx(0.0187, abs=1e-4)
    assert run.unproved == 0


def test_configs_are_copies():
    content = certified.config("obstacle")
    certified.constraint(content, "distance")["clearance_m"] = 1.0
    again = certified.constraint(certified.config("obstacle"), "distance")
    assert again["clearance_m"] < 0.1


def circulating(way: float = 1.0, pace: float = 1.0, away: float = 0.0) -> Circulation:
    """Round the ellipse from its length; `away` from its plane."""
    fine = np.linspace(0.0, 2.0 * math.pi, 20_001)
    a, b = ELLIPSE.radii
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(a * np.cos(fine)),
                                                        np.diff(b * np.sin(fine))))])  # fmt: skip
    gone = (np.arange(TICKS) * T * ELLIPSE.speed * pace) % lengths[-1]
    turn = way * np.interp(gone, lengths, fine)
    path = np.array(ELLIPSE.center) + np.stack(
        [a * np.cos(turn), b * np.sin(turn), np.full(TICKS, away)], axis=1
    )
    v = np.full(TICKS, max(0.5 * away**2, 1e-14))
    run = good_run(v=v, psi=4.0 * v, required=-4.0 * v, given=-4.0 * v)
    curvature = a / b**2 * ELLIPSE.speed**2
    return Circulation(ELLIPSE, way, run, path, curvature)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_perfect_round_passes(way):
    each = circulating(way)
    assert each.rate == pytest.approx(2.0)
    assert failed(circulation.rows({"x": each})) == []


def test_a_round_that_is_not_as_asked_fails():
    good = circulating()
    floor = ELLIPSE.speed * math.sqrt(T / (2.0 * 2.0))
    assert good.floor == pytest.approx(0.5 * floor**2)
    bad = {
        ("rounds in the time",): replace(circulating(-1.0), way=1.0),
        ("rounds in the time", "least speed", "greatest speed"): circulating(pace=0.95),
        ("greatest V", "greatest |e|"): circulating(away=1.01 * floor),
        ("greatest |e|",): circulating(away=0.9 * floor),
    }
    for words, each in bad.items():
        items = failed(circulation.rows({"x": each}))
        assert all(any(word in item for item in items) for word in words), (words, items)


def test_the_ellipse_is_the_controllers():
    path = circulating(away=2e-3).path
    np.testing.assert_allclose(ELLIPSE.alpha(path)[:, 0], 0.0, atol=1e-9)
    np.testing.assert_allclose(ELLIPSE.alpha(path)[:, 1], 2e-3)
    assert ELLIPSE.length == pytest.approx(0.0793272, abs=1e-7)
    run = certified.run(certified.config(circulation.CONFIG), 0.02)
    alpha = ELLIPSE.alpha(circulation.com_path(run.q))
    np.testing.assert_allclose(0.5 * (alpha**2).sum(axis=1), run.v, rtol=1e-9)


def test_what_a_step_of_euler_does_not_see_is_at_least_the_curvature():
    run = certified.run(certified.config(circulation.CONFIG), 0.05)
    unseen = oracle.unseen(ELLIPSE, run.q, circulation.com_path(run.q))
    sharpest = 0.015 / 0.01**2 * 0.01**2
    assert 0.1 * sharpest < unseen < 2.0 * sharpest


@pytest.fixture(scope="module")
def edge():
    return support.go()


def test_the_centre_of_mass_stops_at_the_edge(edge):
    assert failed(support.rows(edge)) == []
    assert edge.done.rho[0] == 1.0
    assert edge.path[-1, 0] == pytest.approx(0.054 - edge.margin, abs=1e-4)


def test_a_motion_that_does_not_stop_at_the_edge_fails(edge):
    ticks = len(edge.path)
    short = slice(0, 700)
    done = edge.done
    early = replace(
        edge,
        path=edge.path[short],
        done=replace(done, v=done.v[short], rho=done.rho[short], held=frozenset()),
    )
    items = " ".join(failed(support.rows(early)))
    for words in ("distance to the edge at the end", "greatest speed", "ρ at the end", CONDITION):
        assert words in items
    over = edge.path + np.linspace(0.0, 1e-3, ticks)[:, None] * np.array([1.0, 0.0, 0.0])
    assert "least distance" in " ".join(failed(support.rows(Support(done, over, edge.target,
                                                                    edge.margin))))  # fmt: skip


def passing(around: float, through: float) -> Obstacle:
    """A ball that is passed at these least distances."""
    dip = 0.1 * np.abs(np.linspace(-1.0, 1.0, TICKS + 1)[:-1])
    run = good_run(v=1e-2 * np.exp(-6.0 * np.arange(TICKS) * T))
    return Obstacle(
        {
            ROUND: Passage(run, around + dip, np.zeros((TICKS, 3))),
            THROUGH: Passage(run, through + dip, np.zeros((TICKS, 3))),
        },
        radius=0.025,
        clearance=0.005,
    )


def test_a_ball_is_passed_at_the_clearance_or_the_row_fails():
    assert failed(obstacle.rows(passing(0.005, -0.01))) == []
    (near,) = failed(obstacle.rows(passing(0.00499, -0.01)))
    assert "least distance from ball" in near
    (free,) = failed(obstacle.rows(passing(0.005, 0.001)))
    assert "without the constraint" in free


@pytest.mark.parametrize("link", obstacle.ARM)
def test_the_distance_from_the_ball_is_that_of_the_nearest_point_of_the_urdfs_box(link):
    center, radius = np.array([0.14, -0.14, 0.03]), 0.025
    ball = {"frame": "pelvis", "center_m": center.tolist(), "radius_m": radius}
    positions = np.random.default_rng(5).uniform(-0.5, 0.5, (20, 21))
    gaps, nearest = oracle.distance_from_ball(ball, link, positions)
    hoap3 = load("hoap3")
    (body,), kinematics = links(hoap3)[link], Kinematics(hoap3)
    place, turn, jacobian = np.zeros(3), np.zeros((3, 3)), np.zeros((6, 21))
    for q, gap, point in zip(positions, gaps, nearest, strict=True):
        kinematics.update(q)
        kinematics.frame(kinematics.frame_id(link), kinematics.frame_id("pelvis"), place, turn,
                         jacobian)  # fmt: skip
        inside = turn.T @ (center - place) - body.center
        on_box = place + turn @ (body.center + np.clip(inside, -body.half, body.half))
        away = np.linalg.norm(on_box - center)
        assert gap == pytest.approx(away - radius, abs=1e-6) or away < 1e-9
        if away > 1e-3:
            np.testing.assert_allclose(point, on_box - center, atol=1e-5)


def test_both_ways_past_the_ball_start_alike_and_one_is_constrained():
    found = obstacle.go(seconds=0.02)
    assert list(found.passages) == [ROUND, THROUGH]
    first, second = found.passages.values()
    assert first.distance[0] == second.distance[0] > 0.05
    assert found.clearance == 0.005
    assert first.done.margin.min() >= 0.0


def test_every_figure_has_its_certificates():
    run = good_run()
    each = circulating()
    ball = passing(0.005, -0.01)
    nearest = np.tile([0.0, 0.05, 0.05], (TICKS, 1))
    ball = replace(ball, passages={k: replace(p, nearest=nearest)
                                   for k, p in ball.passages.items()})  # fmt: skip
    edge = Support(run, each.path, (0.08, 0.02, 0.28), 0.005)
    figures = [
        circulation.draw({"forward": each, "backward": circulating(-1.0)}),
        obstacle.draw(ball),
        support.draw(edge),
    ]
    for figure in figures:
        names = {panel.name for panel in figure.panels}
        assert names >= {"path", "v", "v_rate", "rho", "status"}
        labels = {curve.label for panel in figure.panels for curve in panel.curves}
        assert any("margin" in word for word in {*names, *labels})
        status = next(panel for panel in figure.panels if panel.name == "status")
        assert [status.y.names[STATUS[name]] for name in ("certified", "at_target")] == [
            "certified",
            "at target",
        ]
