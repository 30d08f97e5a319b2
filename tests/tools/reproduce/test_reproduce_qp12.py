"""The QP12 paper re-made: every row passes, and fails where the motion is another one."""

from __future__ import annotations

import csv
import re

import numpy as np
import pytest
from remade_paper import failed, of, remade

from hoap3.tools.bench.solvers import bench_solvers
from hoap3.tools.reproduce.figures import save
from hoap3.tools.reproduce.papers.qp12 import figures, oracle, runs, times
from hoap3.tools.reproduce.papers.qp12 import rows as results
from hoap3.tools.reproduce.papers.qp12.runs import EVEN, LAWS, PINV, SPARSE_CONSTANT, TRIALS, Law
from hoap3.tools.reproduce.rows import MEASURED, NOT_REPRODUCED, REPRODUCED

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def trials():
    return runs.run_trials(print)


@pytest.fixture(scope="module")
def rows(trials):
    return check(trials)


def check(trials):
    plain = runs.plain_pinv(), oracle.all_trials(), oracle.plain_pinv()
    return results.rows(trials, *plain)


@pytest.fixture(scope="module")
def timed():
    return bench_solvers(samples=20)


def test_every_row_is_as_the_equations_have_it(rows):
    assert failed(rows) == []
    judged = [row for row in rows if row.passed]
    assert len(judged) > 50
    assert {re.match(r"Fig\. (\d)", row.item)[1] for row in judged} == set("45678")


def test_where_the_paper_differs_a_row_says_why(rows, timed):
    for row in [*rows, *times.rows(timed)]:
        assert row.differs or row.kind != NOT_REPRODUCED, row.item


def test_each_reading_of_16_is_next_to_the_others(rows):
    """Of the paper's 400 ms, 6 and 18 joints each reading gives another part."""
    kinds = {row.item: row.kind for row in rows}
    for case in "ABC":
        assert kinds[f"Fig. 5a: time to |e| < 1 mm, γ = 0, case {case}"] == NOT_REPRODUCED
        row = of(rows, f"Fig. 5: greatest |u_i| / (u_max·R), (17), case {case}")
        assert (row.ours <= 1.0) is (case != "C")
    joints = [kinds[f"Fig. 6: active joints, γ = 0.1, adaptive, case {case}"] for case in "ABC"]
    assert joints == [NOT_REPRODUCED, NOT_REPRODUCED, REPRODUCED]
    far = {row.item[-1]: row.ours for row in rows if "γ / γ_far at the start" in row.item}
    assert far["B"] > 0.99
    assert max(far["A"], far["C"]) < 0.34


def test_the_oracles_motions_are_ours_to_rounding(trials):
    for case in "ABC":
        motion, expected = trials[case, EVEN], oracle.all_trials()[case, EVEN]
        np.testing.assert_allclose(motion.u[:400], expected.u[:400], atol=1e-11)
        np.testing.assert_allclose(motion.com[:400], expected.com[:400], atol=1e-12)


def test_proposition_6_is_stationary_and_feasible():
    rng = np.random.default_rng(6)
    for gamma in (0.0, 0.1, 0.9, 0.99):
        gradient, b = rng.normal(size=21), 0.3
        u = oracle.proposition_6(gradient, b, gamma)
        assert gradient @ u == pytest.approx(-b)
        moving = u != 0.0
        slope = gamma * np.sign(u) + (1.0 - gamma) * u
        multiplier = slope[moving] / gradient[moving]
        np.testing.assert_allclose(multiplier, multiplier[0], rtol=1e-9)
        assert (np.abs(multiplier[0] * gradient[~moving]) <= gamma + 1e-12).all()


def test_no_two_rows_have_the_same_name(rows, timed):
    items = [row.item for row in [*rows, *times.rows(timed)]]
    assert len(items) == len(set(items))


def test_the_other_psi_fails(trials):
    """What is measured in case A is not what case C should give, and the other way round."""
    other = {"A": "C", "B": "A", "C": "B"}
    swapped = {(other[case], law): motion for (case, law), motion in trials.items()}
    missed = failed(check(swapped))
    for words in ("V(400 ms)/V(0), least", "time to |e| < 1 mm, γ = 0,", "γ = 0.1, adaptive"):
        assert any(words in item for item in missed), words


def test_a_motion_that_is_cut_off_fails_rather_than_guesses():
    short = runs.move(runs.law_settings(EVEN), 0.05)
    assert np.isnan(short.arrival_ms)
    assert len(short.until_a_millimetre.v) == len(short.v)


def test_speeds_are_those_that_the_controller_reports():
    motion = runs.move(runs.law_settings(Law(0.3)), 0.1)
    np.testing.assert_allclose(motion.time_ms, np.arange(100))
    e = motion.com - np.array(runs.TARGET_M)
    np.testing.assert_allclose(0.5 * (e**2).sum(axis=1), motion.v, rtol=1e-9)
    slopes = np.diff(motion.v) / runs.PERIOD_S
    np.testing.assert_allclose(slopes, -motion.psi[:-1], rtol=0.01)  # V̇ = −Ψ


def test_which_joints_start_and_stop_is_counted_in_ticks_per_second():
    active = np.array([[1, 0], [0, 1], [0, 1], [1, 1], [1, 1]], bool)
    assert results._switches_per_s(active) == pytest.approx(500.0)


def test_the_eleven_trials_are_the_papers():
    assert [law.gamma for law in TRIALS] == [*np.arange(10) / 10, 0.99]
    assert all(law.adaptive for law in TRIALS)
    assert str(Law(0.1)) == "γ = 0.1, adaptive"
    assert str(PINV) == "PINV"
    assert set(LAWS) > set(TRIALS)


def test_csv_of_a_figure_is_the_motion(trials, tmp_path):
    names = {path.name for path in save(figures.fig7(trials), tmp_path)}
    assert names == {"fig7.png", "fig7.svg", "fig7_A.csv", "fig7_B.csv", "fig7_C.csv"}
    with (tmp_path / "fig7_C.csv").open(encoding="utf-8", newline="") as stream:
        written = [row for row in csv.DictReader(stream) if row["curve"] == "PINV"]
    counts = [float(row["active_joints"]) for row in written]
    np.testing.assert_array_equal(counts, trials["C", PINV].active_count)


def test_every_figure_has_every_trial(trials):
    drawn = {figure.name: figure for figure in figures.draw_all(trials)}
    assert drawn.keys() == {"fig4", "fig5", "fig6", "fig7", "fig8_A", "fig8_B", "fig8_C"}
    assert all(len(panel.curves) == 11 for panel in drawn["fig5"].panels)
    speeds = [panel for panel in drawn["fig8_A"].panels if panel.name.startswith("u_")]
    assert len(speeds) == 4
    assert {curve.label for curve in speeds[0].curves} == set(runs.joint_names())


def test_the_path_of_figure_4_starts_and_ends_where_the_paper_says(trials):
    com = trials["C", EVEN].com
    np.testing.assert_allclose(com[0], runs.START_M, atol=1e-9)
    np.testing.assert_allclose(com[-1, :2], runs.TARGET_M[:2], atol=1e-4)
    assert np.abs(runs.sole()).max(axis=0) == pytest.approx([0.054, 0.0365])


def test_of_table_1_only_ratios_are_judged(timed):
    found = times.rows(timed)
    judged = [row for row in found if row.passed is not None]
    ratios = "PINV by SVD / QP12", "OSQP / QP12"
    assert [row.item for row in judged] == [f"Table I: {ratio}, mean" for ratio in ratios]
    assert all(row.unit == "us" for row in found if "/" not in row.item)
    assert {row.kind for row in found if row.unit == "us"} == {MEASURED}
    papers = {row.paper for row in found}
    assert {1.259, 1.358, 7.575, 7.713, 12.04, 35.15, 29.64, 32.3, 153.24} <= papers


def test_the_sparsest_moves_no_joint_but_those_of_the_right_ankle(trials):
    motion = trials["A", SPARSE_CONSTANT].until_a_millimetre
    names = np.array(runs.joint_names())
    assert set(names[motion.active.any(axis=0)]) == {"r_ankle_pitch", "r_ankle_roll"}


@pytest.mark.long
def test_the_whole_command(tmp_path):
    pictures = "fig1", "fig4", "fig5", "fig6", "fig7", "fig8_A", "fig8_B", "fig8_C"
    items = remade("qp12", tmp_path, pictures)
    assert {"rows.csv", "rows.json", "fig6.csv"} <= {path.name for path in tmp_path.iterdir()}
    parts = ("Fig. 1", "Fig. 4", "Table I")
    assert all(any(item.startswith(words) for item in items) for words in parts)
