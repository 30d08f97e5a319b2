"""What is written as CSV is what is drawn, and people can read what is drawn."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from hoap3.tools.reproduce.figures import COLOURS, Axis, Curve, Figure, Panel, draw, save

pytestmark = pytest.mark.slow

TIME = np.linspace(0.0, 1.0, 7) / 3.0  # no round numbers
PANEL = Panel(
    "speed",
    "Fast and slow",
    Axis("time_s", "time [s]", (0.0, 0.4)),
    Axis("u_rad_s", "u [rad/s]"),
    (
        Curve("fast", TIME, np.sin(TIME), COLOURS[0], marker="o"),
        Curve("slow", TIME, TIME / 7.0, COLOURS[1], "steps"),
        Curve("quiet", TIME, 0.0 * TIME, legend=""),
    ),
)
PLACES = Panel(
    "",
    "Places",
    Axis("place", ""),
    Axis("time_us", "time [µs]", log=True),
    (Curve("first", np.array([0.1, 0.9]), np.array([1.0, 30.0]), dash="", marker="v"),),
    categories=("here", "there"),
)
FIGURE = Figure("both", "Both", ((PANEL, PLACES),), (8.0, 3.0))


def read(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_csv_has_every_digit_of_what_is_drawn(tmp_path):
    save(FIGURE, tmp_path)
    rows = read(tmp_path / "both_speed.csv")
    lines = draw(FIGURE).axes[0].get_lines()
    assert len(lines) == 3
    for curve, line in zip(PANEL.curves, lines, strict=True):
        written = [
            (float(row["time_s"]), float(row["u_rad_s"]))
            for row in rows
            if row["curve"] == curve.label
        ]
        np.testing.assert_array_equal(np.array(written), line.get_xydata())


def test_things_that_are_counted_are_named_in_the_csv(tmp_path):
    save(FIGURE, tmp_path)
    assert [row["place"] for row in read(tmp_path / "both.csv")] == ["here", "there"]


def test_it_says_which_files_it_wrote_and_writes_the_same_bytes_again(tmp_path):
    files = save(FIGURE, tmp_path)
    assert {path.name for path in files} == {"both.png", "both.svg", "both_speed.csv", "both.csv"}
    assert set(files) == set(tmp_path.iterdir())
    before = {path: path.read_bytes() for path in files}
    save(FIGURE, tmp_path)
    assert {path: path.read_bytes() for path in files} == before


def test_axes_have_labels_and_the_legend_lies_outside_the_data():
    picture = draw(FIGURE)
    picture.draw_without_rendering()
    (legend,) = picture.legends
    assert [text.get_text() for text in legend.get_texts()] == ["first", "fast", "slow"]
    box = legend.get_window_extent()
    for axes in picture.axes:
        assert not box.overlaps(axes.get_window_extent())
    assert picture.axes[0].get_xlabel() == "time [s]"
    assert picture.axes[0].get_xlim() == pytest.approx((0.0, 0.4))
    assert picture.axes[1].get_yscale() == "log"


def test_steps_hold_a_value_until_the_next_point():
    styles = [line.get_drawstyle() for line in draw(FIGURE).axes[0].get_lines()]
    assert styles == ["default", "steps-post", "default"]


def test_values_and_things_with_names_are_named_on_their_axes():
    status = Panel(
        "status",
        "Status",
        Axis("joint", ""),
        Axis("status", "", (-0.5, 1.5), names=("good", "bad")),
        (Curve("status", np.array([0.0, 1.0]), np.array([0.0, 1.0])),),
        categories=("r_knee", "waist"),
    )
    (axes,) = draw(Figure("named", "Named", ((status,),), (4.0, 3.0))).axes
    assert [text.get_text() for text in axes.get_yticklabels()] == ["good", "bad"]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["r\nknee", "waist"]
