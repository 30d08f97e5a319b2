"""Figs. 1 to 3 of the paper on bounds: sets of states are what definitions and areas say."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from remade_paper import assert_all_pass, failed

from hoap3.protocol.errors import BadProblemError
from hoap3.tools.reproduce.papers.bounds import figures, joint
from hoap3.tools.reproduce.papers.bounds import rows as results

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def shares():
    return joint.count_all()


@pytest.fixture(scope="module")
def found():
    return joint.classify()


def test_every_row_of_figure_1_passes():
    assert_all_pass(results.viable_rows())


def test_another_braking_fails_in_figure_1(monkeypatch):
    weaker = joint.Joint(end=1.0, speed=5.0, acceleration=14.0, period_s=0.1)
    strong = joint.kept(joint.FIG_1, 60)
    monkeypatch.setattr(joint, "FIG_1", weaker)
    monkeypatch.setattr(joint, "kept", lambda: strong)
    monkeypatch.setattr(joint, "CELLS", 60)
    missed = failed(results.viable_rows())
    assert any("Fig. 1" in item for item in missed)


def test_a_joint_that_turns_round_within_a_step_has_its_peak_there():
    q, dq, T = np.array([0.0, 0.0, 0.0]), np.array([1.0, 1.0, 1.0]), 0.1
    a = np.array([-20.0, 0.0, 5.0])
    np.testing.assert_allclose(joint.peak(q, dq, a, T), [0.025, 0.1, 0.125])


def test_every_row_of_figure_2_passes(shares):
    assert_all_pass(results.ordering_rows(shares))
    for each in shares:
        assert sum(each.position.values()) == pytest.approx(1.0)
        assert sum(each.viability.values()) == pytest.approx(1.0)


def test_states_that_are_not_viable_have_other_orderings():
    """Those with q beyond the limit, where a₂ is positive: then four of six are not impossible."""
    q, dq = np.array([0.6, 0.45]), np.array([1.0, 0.9])
    counted = joint.count(joint.FIG_3, q, dq)
    assert counted.position["a₃ < a₁ < a₂"] == 0.5
    assert counted.viability["no roots"] == 0.5


def test_at_equal_limits_figure_2_sees_what_must_turn_round():
    T = joint.FIG_3.period_s
    q, dq = np.full(2, 0.45), np.array([0.99, 1.01])  # D = vT/2 lies at 1.0
    counted = joint.count(joint.FIG_3, q, dq)
    assert 2.0 * (joint.FIG_3.end - 0.45) / T == pytest.approx(1.0)
    assert counted.position["a₁ < a₂ < a₃"] == counted.position["a₂ < a₃ < a₁"] == 0.5


def test_every_row_of_figure_3_passes(found):
    rows = results.region_rows(found)
    assert_all_pass(rows)
    assert sum(row.ours for row in rows) == pytest.approx(1.0)


def test_another_period_fails_in_figure_3():
    other = joint.Joint(joint.FIG_3.end, joint.FIG_3.speed, joint.FIG_3.acceleration, 0.09)
    missed = failed(results.region_rows(joint.classify(other, 401)))
    assert any("velocity" in item for item in missed)
    assert any("viability" in item for item in missed)


def test_outlines_enclose_the_regions(found):
    joint_area = 4.0 * joint.FIG_3.end * joint.FIG_3.speed
    for number in figures.STYLES:
        area = 0.0
        for q, dq in figures.outlines(found, number):
            closed = zip([*q, q[0]], [*dq, dq[0]], strict=True)
            area += 0.5 * abs(sum(a * d - c * b for (a, b), (c, d) in pairwise(closed)))
        assert area / joint_area == pytest.approx(found.share(number), abs=2e-3)


def test_what_violates_11_has_no_bounds():
    with pytest.raises(BadProblemError, match=r"\(11\)"):
        joint.FIG_4.bounds(1, 20.0)
