"""The values on the page are those of the log, computed here in another way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from support.command_bench import inside
from support.html_page import Page
from support.tick_story import US

from hoap3.protocol.messages import State
from hoap3.protocol.runtime.deadlines import Deadlines
from hoap3.tools.analysis.canvas import decade, thin
from hoap3.tools.analysis.numbers import number, rate, spread, summary
from hoap3.tools.analysis.report.content import read_content
from hoap3.tools.analysis.report.motion import read_motion
from hoap3.tools.analysis.report.page import page
from hoap3.tools.analysis.report.sources import Sources
from hoap3.tools.analysis.tick_metrics import recent_rates
from hoap3.tools.logs.log import Log


@pytest.fixture(scope="module")
def live(story):
    return Page(page(read_content(story[0])))


@pytest.fixture(scope="module")
def motion(lockstep):
    return read_motion(Sources.open(lockstep[0]))


@pytest.mark.slow
def test_the_figures_of_a_run_in_lockstep_are_those_of_its_summary(lockstep):
    folder, ended = lockstep
    figures = read_content(folder).as_json()
    verdicts = "verdicts", "task", "limits_and_balance"
    for key in (*verdicts, "ticks", "skipped", "safe_stops", "host_stalls", "final_error"):
        assert figures[key] == ended[key], key
    assert figures["interventions"] == ended["interventions"] == 0
    assert figures["success_rate"]["run"] == ended["success_rate"]["run"]
    assert figures["success_rate"]["worst_window"] == ended["success_rate"]["worst_window"]
    assert figures["misses"].items() <= ended["misses"].items()


def test_the_centre_of_mass_is_where_the_controller_proved_it_to_be(motion):
    # V = |m(q) - m_d|²/2 was computed by the controller when it answered
    at = np.searchsorted(motion.path_time_s, motion.time_s)
    error = motion.path_m[at] - motion.target_m
    assert 0.5 * (error**2).sum(axis=1) == pytest.approx(motion.v, rel=1e-9)
    assert motion.frame == "r_sole"
    assert motion.path_m[0] == pytest.approx([-0.0085, 0.0279, 0.2869], abs=1e-6)  # the paper's


def test_the_inputs_are_those_that_the_certificates_speak_of(motion, lockstep):
    assert (np.abs(motion.inputs) >= 1e-3).sum(axis=1).tolist() == motion.active.tolist()
    setpoints = Log.open(lockstep[0], "controller").setpoints()
    assert np.abs(motion.inputs).max(axis=1) == pytest.approx(
        0.6 - setpoints["margin"][: len(motion.inputs)], abs=1e-9
    )
    predicted = setpoints["v_rate_predicted"][: len(motion.psi)]
    assert motion.psi == pytest.approx(-predicted, rel=1e-9)
    assert motion.work.sum() == pytest.approx(1.0)


def test_the_distance_to_the_edge_is_that_of_a_rectangle(motion):
    x, y = motion.path_m[:, 0], motion.path_m[:, 1]
    half_x, half_y = motion.sole_m.max(axis=0)
    expected = np.minimum(half_x - np.abs(x), half_y - np.abs(y))
    assert motion.edge_m == pytest.approx(expected)
    outside = replace(motion, path_m=np.array([[half_x + 0.01, 0.0, 0.0]]))
    assert outside.edge_m == pytest.approx([-0.01])


def test_the_headline_has_the_rate_and_its_n(live):
    lost = 5 + 2 + 2  # vanished, and those that waited behind two slow solves
    asked = 600 - 2
    tile = live.tiles()["answers in time"]
    assert rate((asked - lost) / asked) in tile
    assert f"n {asked}" in tile


def test_outside_stalls_nothing_that_overlaps_one_counts(live):
    tile = live.tiles()["outside stalls"]
    in_time = 600 - 2 - 9  # less two skipped, in the stall, and nine missed, outside of it
    for part in (f"n {in_time + 9}", rate(in_time / (in_time + 9)), "2 stalls, 4.50 ms"):
        assert part in tile


def test_percentiles_of_a_stage_are_those_of_the_lengths_that_it_was_given(live, story):
    _, told = story
    head, *rows = live.rows("ticks", 1)
    assert head == ["µs", "n", "min", "p50", "p90", "p99", "p99.9", "max"]
    wakeup = next(row for row in rows if row[0] == "wakeup")
    given_us = np.array(
        [told.of("wakeup", tick) / US for tick in range(600) if tick not in told.skipped]
    )
    assert wakeup[1] == "598"
    expected = [given_us.min(), *np.percentile(given_us, [50, 90, 99, 99.9], method="higher")]
    for shown, value in zip(wakeup[2:], [*expected, given_us.max()], strict=True):
        assert float(shown) == pytest.approx(value, rel=5e-3)


def test_the_worst_tick_is_the_slow_one_and_its_stage_is_named(live):
    head, first, *_ = live.rows("ticks")
    assert first[0] in {"200", "400"}
    assert first[1] == "late"
    assert first[-1] == "solve"
    assert first[head.index("solve")] == number(2000.0)
    (bold,) = live.by_id("ticks").all("tbody")[0].all("tr")[0].all("b")
    assert bold.text() == number(2000.0)


def test_stalls_are_listed_with_their_lengths(live):
    rows = live.rows("stalls")
    assert rows == [
        ["start [s]", "length [ms]"],
        ["0.300", "4"],
        ["−0.050", "1"],
        ["0.450", "0.500"],
    ]
    text = live.by_id("stalls").text()
    assert "2 stalls, 4.50 ms" in text
    assert "n 3, 5.50 ms" in text


def test_the_success_rate_over_time_is_what_the_robot_counts(story):
    content = read_content(story[0])
    ticks, figures = content.ticks, content.tick_figures
    counted, expected = Deadlines(), []
    for outcome in ticks.outcome[ticks.asked]:
        if outcome == 0:
            counted.hit()
        else:
            counted.miss(arrived=bool(outcome == 1))
        expected.append(counted.success_rate)
    assert recent_rates(ticks) == pytest.approx(expected)
    assert figures["success_rate"]["worst_window"] == pytest.approx(counted.worst_window)
    assert figures["misses"]["longest_run"] == counted.longest_run


def test_events_are_words(lockstep):
    page_ = Page(page(read_content(lockstep[0])))
    rows = page_.rows("events")
    assert rows[0] == ["side", "event", "detail", "times", "tick", "time [s]"]
    told = {(row[0], row[1]): row[2] for row in rows[1:]}
    assert told["robot", "braking"] == "ended"
    assert told["robot", "granted"] == "epoch 1"
    assert told["controller", "reset"].startswith("at tick")


@pytest.mark.slow
def test_the_machine_versions_and_settings_are_on_the_page(lockstep):
    folder, ended = lockstep
    section = Page(page(read_content(folder))).by_id("machine").text()
    for fact in ("kernel", "processor", "cores"):
        assert str(ended["machine"][fact]) in section
    for name, version in ended["machine"]["versions"].items():
        assert f"{name} {version}" in section
    assert "u_max_rad_s: 0.6" in section
    assert "loss_policy: hold" in section


floats = st.floats(-1e12, 1e12)


@given(arrays(float, st.integers(1, 400), elements=floats))
def test_a_summary_is_made_of_values_that_occurred(values):
    figures = summary(values)
    ordered = np.sort(values)
    assert figures["n"] == len(values)
    assert (figures["min"], figures["max"]) == (ordered[0], ordered[-1])
    for key, share in (("p50", 0.5), ("p99", 0.99)):
        assert (values <= figures[key]).mean() >= share - 1e-12
        assert (values < figures[key]).mean() <= share


def test_the_far_tail_needs_enough_samples():
    assert "p99_99" not in summary(np.arange(99_999.0))
    assert "p99.99 99\N{NARROW NO-BREAK SPACE}989" in spread(summary(np.arange(100_000.0)), "µs")
    assert spread(summary([]), "µs") == "n 0"


@given(arrays(float, st.integers(1, 3000), elements=floats), st.integers(2, 50))
def test_thinning_keeps_every_extreme_and_invents_nothing(values, buckets):
    x = np.arange(float(len(values)))
    kept_x, kept = thin(x, values, buckets)
    assert len(kept) <= max(2 * buckets, 1) or len(kept) == len(values)
    assert (kept.min(), kept.max()) == (values.min(), values.max())
    assert (values[kept_x.astype(int)] == kept).all()
    assert (np.diff(kept_x) > 0).all()


@pytest.mark.parametrize(
    ("value", "written"),
    [
        (0.0, "0"),
        (1.754e-4, "1.75·10⁻⁴"),
        (-2.5e-9, "−2.50·10⁻⁹"),
        (0.012345, "0.0123"),
        (12.34, "12.3"),
        (7953.4, "7\N{NARROW NO-BREAK SPACE}953"),
        (float("nan"), "–"),
    ],
)
def test_numbers_are_written_with_three_digits(value, written):
    assert number(value) == written


def test_decades_are_written_as_powers():
    assert [decade(v) for v in (1e-3, 1.0, 100.0, 2e-3)] == ["10⁻³", "10⁰", "10²", ""]


def test_only_the_active_part_of_a_log_is_motion(lockstep, motion):
    states = Log.open(lockstep[0], "robot").states()
    assert len(motion.path_m) == (states["mode"] == State.ACTIVE).sum() < len(states)


def test_v_of_a_default_pose_is_no_distance(tmp_path):
    inside(
        "run",
        "--lockstep",
        "--robot",
        "ur5",
        "--controller",
        "tsid",
        "--duration",
        0.02,
        "--out",
        tmp_path,
    )
    motion = read_motion(Sources.open(tmp_path))
    assert motion.target_m is not None
    assert not motion.v_in_metres
