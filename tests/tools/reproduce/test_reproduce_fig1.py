"""Fig. 1: what solvers find on the line is what geometry says, and what is not so fails."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from remade_paper import assert_all_pass, failed

from hoap3.tools.reproduce.papers.qp12 import fig1

pytestmark = pytest.mark.slow

STEEP = st.floats(-3.0, 3.0).filter(lambda x: abs(x) > 0.1)


def test_every_row_passes():
    rows = fig1.rows()
    assert_all_pass(rows)
    counts = [row.ours for row in rows if "ends found" in row.item]
    assert counts == [0, 2, 1, 2]


@given(first=STEEP, second=STEEP, share=st.floats(0.05, 0.95))
def test_two_lps_find_where_the_line_cuts_the_polygon(first, second, share):
    case = fig1.Case("", "", np.array([first, second]), share)
    np.testing.assert_allclose(fig1.by_solvers(case), case.known, atol=1e-8)


@given(first=STEEP, second=STEEP, share=st.floats(1.05, 3.0))
def test_above_the_greatest_rho_neither_finds_anything(first, second, share):
    case = fig1.Case("", "", np.array([first, second]), share)
    assert len(fig1.by_solvers(case)) == len(case.known) == 0


def test_geometry_knows_corners_and_edges():
    point, edge = (case.known for case in fig1.CASES[2:])
    np.testing.assert_allclose(point, [[0.5, 1.0], [0.5, 1.0]])
    assert sorted(edge[:, 0].tolist()) == pytest.approx([0.5, 1.0])
    assert edge.sum(axis=1) == pytest.approx([1.5, 1.5])


def test_solvers_with_another_polygon_fail(monkeypatch):
    monkeypatch.setattr(fig1, "B", fig1.B - np.array([0.0, 0.0, 0.0, 0.0, 0.1]))
    missed = failed(fig1.rows())
    for words in ("ρ*, line through a corner", "ρ*, edge", "one point, ends found", "edge, ends"):
        assert any(words in item for item in missed), words


def test_the_picture_shows_what_is_feasible():
    panels = fig1.draw().panels
    curves = [curve for panel in panels for curve in panel.curves]
    assert [len(curve.x) for curve in curves if curve.label == "feasible"] == [2, 1, 2]
    assert [panel.name for panel in panels] == ["a", "b", "c", "c_edge"]
