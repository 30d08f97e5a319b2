"""The paper on hierarchies re-made: rows pass, and fail where the motion is another one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from remade_paper import failed, of, remade

from hoap3.tools.reproduce.figures import save
from hoap3.tools.reproduce.papers.ghc import figures, oracle, runs, times
from hoap3.tools.reproduce.papers.ghc import rows as results
from hoap3.tools.reproduce.papers.ghc.runs import ELBOW, HAND, POSTURE, TASKS, Run
from hoap3.tools.reproduce.papers.ghc.runs import switching as switch
from hoap3.tools.reproduce.rows import MEASURED, NOT_REPRODUCED, REPRODUCED

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def fast():
    """All hierarchies of Table 1, and the insertion that follows."""
    return switch("ghc", runs.FAST_S, 4.2 * runs.PHASE_S)


@pytest.fixture(scope="module")
def eight():
    """Until the end of 1 ▷ 2 ▷ 3."""
    return runs.track(2.0 * runs.PHASE_S)


@pytest.fixture(scope="module")
def pressed():
    return runs.press(8.0, 0.5)


def still(ticks: int, **changes: object) -> Run:
    """A run in which nothing moves; `changes` replace its arrays."""
    errors = {task: np.zeros(ticks) for task in TASKS}
    joints = [np.zeros((ticks, 7)) for _ in range(3)]
    run = Run(1e-3, errors, np.zeros((ticks, 3, 3)), *joints, np.zeros(ticks), 0)
    return replace(run, **changes)  # type: ignore[arg-type]


def test_every_error_of_table_1_is_the_printed_one_with_fitted_targets_but_for_the_highest(fast):
    rows = results.tabled("GHC", fast)
    assert not failed(rows)
    assert len(rows) == 12
    lower = [row for row in rows if row.tolerance is None]
    assert len(lower) == 8
    assert {(row.kind, row.fitted) for row in lower} == {(REPRODUCED, results.FITTED)}
    highest = [row for row in rows if row.tolerance is not None]
    assert all(row.tolerance == (None, 1e-4) and row.differs for row in highest)
    assert of(rows, "1 ▷ 2 ▷ 3, GHC, hand").kind == NOT_REPRODUCED
    assert of(rows, "1 ▷ 2 ▷ 3, GHC, hand").as_json()["paper"] == 1e-6


def test_another_hierarchys_errors_fail(fast):
    """Hand and elbow swapped: wherever the table says different things of them, it fails."""
    errors = {HAND: fast.errors[ELBOW], ELBOW: fast.errors[HAND], POSTURE: fast.errors[POSTURE]}
    found = failed(results.tabled("GHC", replace(fast, errors=errors)))
    assert len(found) >= 6


def test_priorities_are_those_of_15_at_every_tick(fast):
    (row,) = results.alpha_rows({runs.FAST_S: fast})
    assert row.passed
    assert failed(results.alpha_rows({0.006: fast}))
    wrong = fast.alpha.copy()
    wrong[-1, 0, 1] += 1e-9
    assert failed(results.alpha_rows({runs.FAST_S: replace(fast, alpha=wrong)}))


def test_hierarchies_are_those_of_the_paper():
    above = [np.argwhere(oracle.hierarchy(phase) == 1.0) + 1 for phase in range(5)]
    named = [set(map(tuple, each.tolist())) for each in above]
    assert named[0] == {(1, 2), (1, 3), (2, 3)}  # 3 ▷ 2 ▷ 1
    assert named[1] == named[4] == {(2, 1), (3, 1), (3, 2)}  # 1 ▷ 2 ▷ 3
    assert named[2] == {(1, 2), (3, 1), (3, 2)}  # 2 ▷ 1 ▷ 3
    assert named[3] == {(3, 1), (2, 1), (2, 2), (2, 3)}  # 1 ▷ 3, without 2


def test_half_of_a_transition_is_a_half():
    middle = oracle.expected(np.array([runs.PHASE_S + 0.5]), 1.0)[0]
    assert middle[0, 1] == pytest.approx(0.5)
    assert middle[1, 0] == pytest.approx(0.5)


@pytest.mark.long
def test_slow_transitions_jerk_half_as_much_at_most(fast):
    slow = switch("ghc", runs.SLOW_S, 4.0 * runs.PHASE_S)
    rows = results.jerk_rows({"HQP": fast, "GHC, 5 ms": fast, "GHC, 2 s": slow})
    row = of(rows, "jerk|, GHC 5 ms / GHC 2 s")
    assert row.tolerance == (2.0, None)
    assert row.passed
    other = results.jerk_rows({"HQP": slow, "GHC, 5 ms": slow, "GHC, 2 s": fast})
    assert not of(other, "jerk|, GHC 5 ms / GHC 2 s").passed


@pytest.mark.long
def test_hqp_that_changes_at_once_jerks_more_than_ghc(fast):
    hqp = switch("hqp", 0.0, runs.PHASE_S + 1.0, w_r=runs.HQP_DAMPING)
    rows = results.jerk_rows({"HQP": hqp, "GHC, 5 ms": fast, "GHC, 2 s": fast})
    row = of(rows, "jerk|, HQP / GHC 5 ms")
    assert row.tolerance == (1.0, None)
    assert row.passed
    assert of(rows, "without an answer, HQP").passed


def test_jerk_is_the_sum_of_what_accelerations_change_by():
    dq = np.zeros((5, 7))
    dq[2:, 0] = 1e-3  # an acceleration of 1 rad/s² for one tick
    dq[3:, 1] = -2e-3
    np.testing.assert_allclose(still(5, dq=dq).jerk, [0.0, 0.0, 1.0, 4.0, 6.0], atol=1e-12)


def test_bounds_of_figure_8_are_kept_and_reached(eight):
    rows = results.lemniscate_rows(eight)
    assert not failed(rows)
    assert of(rows, "|dq|").tolerance[1] == pytest.approx(1.2 + 1e-6, abs=1e-12)
    assert of(rows, "|τ|").tolerance[1] == pytest.approx(1.5 + 1e-6, abs=1e-12)
    assert of(rows, "without an answer").ours == 0.0
    assert of(rows, "ticks at a bound").ours > 100


def test_what_exceeds_a_bound_by_two_millionths_fails(eight):
    dq, tau = eight.dq.copy(), eight.tau.copy()
    dq[5000, 3], tau[5000, 2] = 1.2 + 2e-6, -1.5 - 2e-6
    rows = results.lemniscate_rows(replace(eight, dq=dq, tau=tau, fallbacks=1))
    assert len(failed(rows)) == 3


def test_the_path_of_figure_6_is_the_desired_one(eight, tmp_path):
    drawn = {figure.name: figure for figure in figures.draw_lemniscate(eight)}
    assert drawn.keys() == {"fig6", "fig7", "fig8"}
    (panel,) = drawn["fig6"].panels
    desired, hand = panel.curves
    gaps = np.hypot(desired.x[:, None] - hand.x, desired.y[:, None] - hand.y).min(axis=0)
    assert gaps[-300:].max() < 1e-3  # before that it comes from elsewhere
    assert np.ptp(desired.x) == pytest.approx(0.2, abs=1e-3)
    names = {path.name for path in save(drawn["fig8"], tmp_path)}
    assert {"fig8_speeds.csv", "fig8_torques.csv"} <= names


def test_the_hand_is_where_its_error_says(eight):
    shown = eight.rows(0.0, 0.001)
    place = runs.hand_path(eight.q[shown])[0]
    start = np.array(runs.CENTER_M)
    far = float(np.linalg.norm(place - start))
    assert far > 0.4  # its target approaches from where the hand is
    assert eight.errors[HAND][0] == pytest.approx(0.0, abs=1e-3)


def test_ten_newtons_and_a_place_are_kept_after_the_change(pressed):
    rows = results.pressing_rows(pressed, 0.5)
    assert not failed(rows)
    force = of(rows, "greatest error of the force")
    assert force.tolerance == (None, 0.05)
    assert of(rows, "horizontal").tolerance == (None, 1e-3)
    assert of(rows, "impact").ours > 10.0
    light = replace(pressed, force=0.994 * pressed.force)
    assert len(failed(results.pressing_rows(light, 0.5))) == 2
    figure = figures.draw_pressing(pressed)
    assert [panel.name for panel in figure.panels] == ["alpha", "errors", "force"]


@pytest.mark.long
def test_compromises_are_monotone():
    by_alpha = {alpha: runs.compromise(alpha, 6.0) for alpha in (0.0, 0.5, 1.0)}
    assert not failed(results.compromise_rows(by_alpha))
    turned = {1.0 - alpha: found for alpha, found in by_alpha.items()}
    assert len(failed(results.compromise_rows(turned))) >= 4
    figure = figures.draw_compromises(by_alpha)
    assert [panel.name for panel in figure.panels] == ["alpha", "tradeoff"]


def test_times_are_not_judged_but_their_trends_are():
    def row(robot, tasks, us):
        return {"robot": robot, "tasks": tasks, "p50_us": us, "min_us": us}

    robots = (("lwr", 5.0), ("humanoid32", 15.0))
    timed = [row(robot, k, us * k) for robot, us in robots for k in (1, 5, 7)]
    rows = times.rows(timed)
    assert [row.passed for row in rows if row.unit == "ms"] == [None, None]
    assert {row.kind for row in rows if row.unit == "ms"} == {MEASURED}
    assert {row.paper for row in rows if row.unit == "ms"} == {2.7, 88.0}
    judged = [row for row in rows if row.passed is not None]
    assert len(judged) == 3
    assert all(row.passed for row in judged)
    falling = times.rows([{**each, "min_us": 1.0 / each["min_us"]} for each in timed])
    assert len(failed(falling)) == 3
    assert [panel.name for panel in times.draw(timed).panels] == ["lwr", "humanoid32"]


def test_figures_of_errors_have_every_task_and_joint(fast):
    figure = figures.errors("fig3", "Fig. 3: GHC", fast, runs.FAST_S)
    alpha, errors, joints = figure.panels
    assert len(alpha.curves) == 4
    labels = [curve.label for curve in errors.curves]
    assert labels == ["task 1, hand", "task 2, elbow", "task 3, posture"]
    assert len(joints.curves) == 7
    np.testing.assert_array_equal(errors.curves[0].y, fast.errors[HAND][::10])


@pytest.mark.long
def test_the_whole_command(tmp_path):
    pictures = [f"fig{number}" for number in (2, 3, 4, 5, 6, 7, 8, 10, 11, 12)]
    rows = remade("ghc", tmp_path, pictures)
    jerk = [rows[f"Fig. 5: ∫|jerk| over four hierarchies, {name}"]["ours"]
            for name in ("HQP", "GHC, 5 ms", "GHC, 2 s")]  # fmt: skip
    assert jerk[0] > jerk[1] > 2.0 * jerk[2]
    table = [item for item in rows if "Table 1" in item and "HQP" in item]
    assert len(table) >= 3 * len(results.TABLE_1["HQP"])
