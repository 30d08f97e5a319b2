"""Figs. 1 to 3 of the paper on bounds: sets of states are what definitions and areas say."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import failed

from hoap3.protocol.errors import BadProblemError
from hoap3.tools.reproduce.papers.bounds import joint, orderings, regions, viable_set

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def shares():
    return orderings.count_all()


@pytest.fixture(scope="module")
def found():
    return regions.classify()


def test_every_row_of_figure_1_passes():
    rows = viable_set.rows()
    assert failed(rows) == []
    assert len(rows) == len({row.item for row in rows})


def test_another_braking_fails_in_figure_1(monkeypatch):
    weaker = joint.Joint(end=1.0, speed=5.0, acceleration=14.0, period_s=0.1)
    monkeypatch.setattr(viable_set, "FIG_1", weaker)
    strong = viable_set.kept(joint.FIG_1, 60)
    monkeypatch.setattr(viable_set, "kept", lambda: strong)
    monkeypatch.setattr(viable_set, "CELLS", 60)
    missed = failed(viable_set.rows())
    assert "Fig. 1: states where braking and (10) disagree" in missed
    assert any("δt = 0.1 s" in item for item in missed)


@given(room=st.floats(1e-4, 3.0), period=st.sampled_from([0.01, 0.03, 0.1]))
def test_velocity_control_stops_just_before_the_wall(room, period):
    A = 15.0

    def stops(w):
        way = 0.0
        while w > 0.0:
            way += w * period
            w -= A * period
        return way <= room * (1.0 + 1e-12)

    fastest = float(viable_set.velocity_control(np.array(room), A, period))
    assert stops(fastest * (1.0 - 1e-9))
    assert not stops(fastest * (1.0 + 1e-6))
    assert viable_set.smooth(np.array(room), A, period) <= fastest * (1.0 + 1e-12)
    assert fastest < np.sqrt(2.0 * A * room)


def test_a_joint_that_turns_round_within_a_step_has_its_peak_there():
    q, dq, T = np.array([0.0, 0.0, 0.0]), np.array([1.0, 1.0, 1.0]), 0.1
    a = np.array([-20.0, 0.0, 5.0])
    np.testing.assert_allclose(viable_set.peak(q, dq, a, T), [0.025, 0.1, 0.125])


def test_every_row_of_figure_2_passes(shares):
    rows = orderings.rows(shares)
    assert failed(rows) == []
    assert len(rows) == len({row.item for row in rows})
    for each in shares:
        assert sum(each.position.values()) == pytest.approx(1.0)
        assert sum(each.viability.values()) == pytest.approx(1.0)


def test_states_that_are_not_viable_have_other_orderings():
    """Those with q beyond the limit, where a₂ is positive: then four of six are not impossible."""
    q, dq = np.array([0.6, 0.45]), np.array([1.0, 0.9])
    counted = orderings.count(joint.FIG_3, q, dq)
    assert counted.position["a₃ < a₁ < a₂"] == 0.5
    assert counted.viability["no roots"] == 0.5


def test_at_equal_limits_figure_2_sees_what_must_turn_round():
    T = joint.FIG_3.period_s
    q, dq = np.full(2, 0.45), np.array([0.99, 1.01])  # D = vT/2 lies at 1.0
    counted = orderings.count(joint.FIG_3, q, dq)
    assert 2.0 * (joint.FIG_3.end - 0.45) / T == pytest.approx(1.0)
    assert counted.position["a₁ < a₂ < a₃"] == counted.position["a₂ < a₃ < a₁"] == 0.5


def test_every_row_of_figure_3_passes(found):
    rows = regions.rows(found)
    assert failed(rows) == []
    assert sum(row.ours for row in rows) == pytest.approx(1.0)


def test_another_period_fails_in_figure_3():
    other = joint.Joint(joint.FIG_3.end, joint.FIG_3.speed, joint.FIG_3.acceleration, 0.09)
    missed = failed(regions.rows(regions.classify(other, 401)))
    assert any("velocity" in item for item in missed)
    assert any("viability" in item for item in missed)


def test_outlines_enclose_the_regions(found):
    joint_area = 4.0 * joint.FIG_3.end * joint.FIG_3.speed
    for number in regions.LOOKS:
        area = 0.0
        for q, dq in regions.outlines(found, number):
            closed = zip([*q, q[0]], [*dq, dq[0]], strict=True)
            area += 0.5 * abs(sum(a * d - c * b for (a, b), (c, d) in pairwise(closed)))
        assert area / joint_area == pytest.approx(found.share(number), abs=2e-3)


def test_what_violates_11_has_no_bounds():
    with pytest.raises(BadProblemError, match=r"\(11\)"):
        joint.FIG_4.bounds(1, 20.0)


def test_every_axis_says_its_unit(shares, found):
    figures = [viable_set.draw(), orderings.draw(shares), regions.draw(found)]
    assert [figure.name for figure in figures] == ["fig1", "fig2", "fig3"]
    for panel in (panel for figure in figures for panel in figure.panels):
        assert "[" in panel.y.label or panel.y.label.startswith("share of")
        assert "[" in panel.x.label or panel.categories
