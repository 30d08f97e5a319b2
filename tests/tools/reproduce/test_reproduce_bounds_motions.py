"""Figs. 4 and 5 of the paper on bounds: motions are as the paper has them, and others fail."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from remade_paper import assert_all_pass, remade

from hoap3.tools.reproduce.papers.bounds import elbow, figures, joint
from hoap3.tools.reproduce.papers.bounds import rows as results
from hoap3.tools.reproduce.papers.bounds.joint import FIG_4
from hoap3.tools.reproduce.rows import NOT_REPRODUCED, REPRODUCED

pytestmark = pytest.mark.slow


def failed(rows):
    return [row.item for row in rows if row.passed is not True]


@pytest.fixture(scope="module")
def runs():
    return joint.run_all()


@pytest.fixture(scope="module")
def arms():
    return elbow.run_all(print)


def test_every_row_of_figure_4_passes(runs):
    assert_all_pass(results.motion_rows(runs))


def test_naive_bounds_in_place_of_the_proposed_fail(runs):
    naive = dict.fromkeys(runs.proposed, runs.naive[2.0])
    missed = failed(results.motion_rows(replace(runs, proposed=naive, shrunk=runs.naive[20.0])))
    kept = [item for item in missed if item.endswith("excess over q_max")]
    assert len(kept) == len(runs.proposed) + 1


def test_proposed_bounds_in_place_of_the_naive_fail(runs):
    gentle = dict.fromkeys(runs.naive, runs.proposed[2.0])
    missed = failed(results.motion_rows(replace(runs, naive=gentle)))
    assert sum(item.startswith("Fig. 4: naive") for item in missed) == 2 * len(runs.naive)


def test_a_joint_that_chatters_is_not_at_rest(runs):
    chatter = dict.fromkeys(runs.proposed, runs.proposed[1.0])
    missed = failed(results.motion_rows(replace(runs, proposed=chatter)))
    assert sum("rms acceleration" in item for item in missed) == len(runs.proposed) - 1


def test_a_motion_that_is_not_refused_fails(runs):
    missed = failed(results.motion_rows(replace(runs, refused="")))
    assert missed == ["Fig. 4: proposed ×20, errors that name (11)"]


def test_the_target_of_figure_4_is_the_printed_one():
    assert pytest.approx(FIG_4.end + 0.1) == joint.TARGET


@pytest.mark.parametrize("target", [2.2, 100.0])
def test_how_far_beyond_the_limit_the_target_lies_does_not_matter(runs, target, monkeypatch):
    monkeypatch.setattr(joint, "TARGET", target)
    other = joint.move(2.0, naive=True)
    assert other.excess == pytest.approx(runs.naive[2.0].excess, rel=1e-9)


def test_the_excess_is_found_between_ticks():
    run = joint.Run(FIG_4, np.array([1.999]), np.array([0.1]), np.array([-12.0]))
    assert run.excess == 0.0
    run = joint.Run(FIG_4, np.array([1.9997]), np.array([0.1]), np.array([-12.0]))
    assert run.excess == pytest.approx(0.1**2 / 24.0 - 3e-4)
    assert math.isnan(run.speed_at_limit)


def test_figure_4_shows_every_way(runs):
    figure = figures.draw_motions(runs)
    assert len(figure.panels) == 12
    for panel in figure.panels:
        shown = {curve.label for curve in panel.curves if not curve.label.startswith("limit")}
        assert shown == ({"×1"} if panel.name[-1] in "ac" else {"×2", "×3", "×5", "×10", "×20"})


def test_every_row_of_figure_5_passes(arms):
    rows = results.elbow_rows(arms)
    assert [row.item for row in rows if row.passed is False] == []
    kinds = {row.item: (row.kind, row.fitted) for row in rows}
    for words in ("time", "velocity"):
        found = kinds[f"Fig. 5: naive ×2, elbow at its limit, {words}"]
        assert found == (REPRODUCED, "start and goal, for ×2")
    assert kinds["Fig. 5: naive ×20, elbow at its limit, velocity"][0] == NOT_REPRODUCED
    assert len(rows) == len({row.item for row in rows})


def test_naive_bounds_in_place_of_the_proposed_let_the_elbow_through(arms):
    naive = arms.ideal["naive", 2.0]
    ideal = dict.fromkeys(arms.ideal, naive)
    missed = failed(results.elbow_rows(replace(arms, ideal=ideal)))
    assert sum("least distance" in item for item in missed) == 3


def test_a_motion_that_does_not_cross_or_arrive_fails(arms):
    still = elbow.Run(np.ones(9), np.zeros(9), np.zeros(9), np.ones(9), fallbacks=1)
    ideal = dict.fromkeys(arms.ideal, still)
    missed = failed(results.elbow_rows(replace(arms, ideal=ideal, none=())))
    elbows = "naive ×2, elbow", "naive ×20, elbow"
    for words in (*elbows, "after 4 s", "too small", "joints without"):
        assert any(words in item for item in missed), words


def test_the_crossing_is_found_between_ticks():
    room, dq = np.array([0.1, -0.05]), np.array([-1.0, -2.0])
    time, speed = elbow.Run(room, dq, np.array([-10.0, 0.0]), room).crossing
    assert 0.1 + time * -1.0 - 5.0 * time**2 == pytest.approx(0.0, abs=1e-12)
    assert speed == pytest.approx(-1.0 - 10.0 * time)


def test_figure_5_shows_both_kinds_of_bounds(arms):
    panels = {panel.name: panel for panel in figures.draw_elbow(arms).panels}
    assert len(panels) == 8
    (limit, *shown) = panels["e1_minus_limit_rad_naive"].curves
    assert limit.y.tolist() == [0.0, 0.0]
    assert min(curve.y.min() for curve in shown) < -0.02
    shown = panels["e1_minus_limit_rad_proposed"].curves
    assert min(curve.y.min() for curve in shown) == 0.0


def test_where_the_paper_differs_a_row_says_why(runs, arms):
    for row in [*results.motion_rows(runs), *results.elbow_rows(arms)]:
        assert row.differs or row.kind != NOT_REPRODUCED, row.item


@pytest.mark.long
def test_the_whole_command(tmp_path):
    items = remade("bounds", tmp_path, [f"fig{figure}" for figure in (1, 3, 4, 5)])
    for figure in range(1, 6):
        assert any(item.startswith(f"Fig. {figure}:") for item in items)
        if figure == 2:  # a drawing in the paper, rows here
            continue
        assert (tmp_path / f"fig{figure}.png").stat().st_size > 10_000
        assert list(tmp_path.glob(f"fig{figure}*.csv"))
