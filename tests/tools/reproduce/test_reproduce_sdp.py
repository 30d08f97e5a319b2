"""The paper on gains by semidefinite programming re-made: rows pass, and other runs fail."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
from remade_paper import failed, of, remade

from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.figures import save
from hoap3.tools.reproduce.papers.sdp import figures, oracle, runs
from hoap3.tools.reproduce.papers.sdp import rows as results
from hoap3.tools.reproduce.rows import CONFIRMED, MEASURED

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def ur5():
    return runs.run_all()


@pytest.fixture(scope="module")
def expected():
    return oracle.run_all()


def changed(run, name, step, value):
    """The run with one step of an array replaced."""
    values = getattr(run, name).copy()
    values[step] = value
    return replace(run, **{name: values})


def test_v_beta_gains_and_speeds_are_the_oracles(ur5, expected):
    rows = results.figure_rows(ur5, expected)
    assert failed(rows) == []
    assert len(rows) == len({row.item for row in rows}) > 60
    row = of(rows, "V(3 s), β̃ = 2")
    assert row.tolerance == pytest.approx((7.967867e-5, 7.967867e-5), rel=2e-6)
    assert of(rows, "steps with a joint at its limit, β̃ = 8, 4").tolerance == (36.0, 36.0)
    assert expected.fast.proved.all()
    assert expected.limited.proved.all()


def test_a_run_with_another_limit_is_not_the_oracles(ur5, expected):
    missed = failed(results.figure_rows(replace(ur5, fast=ur5.limited), expected))
    assert sum("V(" in item for item in missed) >= 4
    assert any("greatest |dq|" in item for item in missed)


def test_a_millionth_off_the_oracle_fails():
    assert results.same("", 0.23149, 0.23149 * (1.0 + 9e-7), "").passed
    assert not results.same("", 0.23149, 0.23149 * (1.0 + 2e-6), "").passed


def test_constant_gains_have_a_negative_beta_at_every_step_and_keep_the_wrists_error(ur5, expected):
    rows = results.figure_rows(ur5, expected)
    assert ur5.constant.beta.max() < 0.0
    assert of(rows, "least β, constant").passed
    assert of(rows, "greatest β, constant").passed
    assert of(rows, "V(3 s), constant").ours == pytest.approx(1.96e-3, rel=3e-3)
    end = ur5.constant.at(3.0)
    left = np.abs(ur5.constant.errors[end])
    assert left[3] > 0.06 > 10.0 * left[:3].max()


def test_the_second_gain_falls_and_rises(ur5, expected):
    rows = [row for row in results.figure_rows(ur5, expected) if row.item.startswith("Fig. 3")]
    assert len(rows) == 8
    start, least, greatest, _ = (row.ours for row in rows[4:])
    assert least < 0.6 * start < start < greatest
    flat = replace(ur5.fast, gains=np.full_like(ur5.fast.gains, start))
    missed = failed(results.figure_rows(replace(ur5, fast=flat), expected))
    assert sum(item.startswith("Fig. 3") for item in missed) == 3


def test_every_claim_is_as_it_should_be(ur5, expected):
    rows = results.claim_rows(ur5, expected)
    assert failed(rows) == []
    assert len(rows) == len({row.item for row in rows})
    assert of(rows, "slower than constant gains").reference == pytest.approx(1.7)
    assert {row.kind for row in rows} == {CONFIRMED, MEASURED}


def test_v_that_rises_once_fails(ur5):
    up = ur5.fast.errors.copy()
    up[200:] *= 1.03
    rows = results.certificate("it", replace(ur5.fast, errors=up))
    slower = "(d) steps of 400 in which V falls more slowly than β, it"
    assert failed(rows) == ["(a) V⁺/V, greatest, it", slower]


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("beta", 0.0, "without a certificate"),
        ("proved", False, "not proved"),
        ("dq", np.nextafter(6.0, 7.0), "|dq| − limit"),
        ("dq", np.nextafter(-6.0, -7.0), "|dq| − limit"),
        ("beta", 99.0, "more slowly"),
    ],
)
def test_a_single_step_fails(ur5, name, value, words):
    rows = results.certificate("it", changed(ur5.fast, name, 123, value))
    (item,) = failed(rows)
    assert words in item


def test_v_falls_more_slowly_than_certified_at_long_periods_only(ur5):
    behind = {dt: run.behind for dt, run in ur5.periods.items()}
    assert [behind[dt] > 0 for dt in runs.PERIODS_S] == [True, True, False, False]
    assert behind[0.1] <= 4
    assert behind[0.05] <= 4
    rates = {dt: (1.0 - run.v[1:] / run.v[:-1]) / dt for dt, run in ur5.periods.items()}
    early = [np.flatnonzero(rates[dt] < run.beta[:-1]).max() * dt
             for dt, run in ur5.periods.items() if dt >= results.BEHIND_S]  # fmt: skip
    assert max(early) < 0.3
    hasty = replace(ur5.periods[0.05], beta=np.full_like(ur5.periods[0.05].beta, 1e-3))
    assert failed(results.certificate("it", hasty)) == [
        "(d) steps of 80 in which V falls more slowly than β, it"
    ]


def test_a_slower_run_in_place_of_the_faster_fails(ur5, expected):
    swapped = replace(ur5, slow=ur5.fast, fast=ur5.slow)
    missed = failed(results.speeds(swapped, expected))
    assert len(missed) == 3


def test_the_toolboxs_frames_are_those_of_our_description():
    """But for 0.3 mm of height, which the toolbox has otherwise."""
    robot = load("ur5")
    kinematics = Kinematics(robot)
    base = kinematics.frame_id("base")
    place, turn, jacobian = np.zeros(3), np.zeros((3, 3)), np.zeros((6, 6))
    for seed in range(5):
        q = np.random.default_rng(seed).uniform(-3.0, 3.0, 6)
        kinematics.update(q)
        axes, origins = runs.frames(q)
        for number, name in ((4, "wrist_1_link"), (5, "wrist_2_link"), (6, "wrist_3_link")):
            kinematics.frame(kinematics.frame_id(name), base, place, turn, jacobian)
            assert origins[number] - place == pytest.approx([0.0, 0.0, 3e-4], abs=1e-12)
            if number == 6:
                assert axes[number] == pytest.approx(turn[:, 2], abs=1e-12)


def test_jacobians_are_the_derivatives_of_what_the_errors_are_of():
    q, step = np.random.default_rng(0).uniform(-1.0, 1.0, 6), 1e-6
    J, _ = runs.tasks(q)
    for joint in range(6):
        away = np.eye(6)[joint] * step
        slope = (runs.tasks(q - away)[1] - runs.tasks(q + away)[1]) / (2.0 * step)
        assert J[:, joint] == pytest.approx(slope, abs=1e-8)


def test_figures_have_the_curves_of_the_paper(ur5, tmp_path):
    drawn = {figure.name: figure for figure in figures.draw_all(ur5)}
    assert [*drawn] == [f"fig{number}" for number in range(1, 8)]
    counts = {name: [len(panel.curves) for panel in figure.panels]
              for name, figure in drawn.items()}  # fmt: skip
    assert [*counts.values()] == [[3, 3], [3, 3], [3], [6 + 2], [2], [4], [4, 4]]
    (gains,) = drawn["fig3"].panels
    np.testing.assert_array_equal(gains.curves[2].y, ur5.fast.gains[:, 3])
    for panel in drawn["fig7"].panels:
        for curve, run in zip(panel.curves, ur5.periods.values(), strict=True):
            np.testing.assert_array_equal(curve.y, np.abs(run.errors[:, 3]))
    names = {path.name for path in save(drawn["fig2"], tmp_path)}
    assert names == {"fig2.png", "fig2.svg", "fig2_hand.csv", "fig2_wrist.csv"}
    with (tmp_path / "fig2_wrist.csv").open(encoding="utf-8", newline="") as stream:
        points = [row for row in csv.reader(stream) if row[0] == "β̃ = 8"]
    assert len(points) == 401
    assert float(points[-1][2]) == abs(ur5.fast.errors[-1, 3])


def test_delta_alone_lowers_beta(ur5):
    assert failed(results.regularised(ur5)) == []
    at_its_limit = replace(ur5, slow=ur5.fast)
    missed = failed(results.regularised(at_its_limit))
    assert missed == ["(27): β(0), β̃ = 2, δ = 5·10⁻⁵", "(27): least distance from a limit there"]


def test_two_runs_are_the_same():
    a, b = (runs.scheduled(8.0, seconds=0.5) for _ in range(2))
    for name in ("errors", "beta", "gains", "dq"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


@pytest.mark.long
def test_the_whole_command(tmp_path):
    remade("sdp", tmp_path, [f"fig{number}" for number in range(1, 8)])
