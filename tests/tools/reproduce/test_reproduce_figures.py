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
    Axis("place", "place"),
    Axis("time_us", "time [µs]", log=True),
    (Curve("first", np.array([0.1, 0.9]), np.array([1.0, 30.0]), dash="", marker="v"),),
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
        points = [row for row in rows if row["curve"] == curve.label]
        written = [(float(row["time_s"]), float(row["u_rad_s"])) for row in points]
        np.testing.assert_array_equal(np.array(written), line.get_xydata())


def test_it_says_which_files_it_wrote_and_writes_the_same_bytes_again(tmp_path):
    files = save(FIGURE, tmp_path)
    assert {path.name for path in files} == {"both.png", "both.svg", "both_speed.csv", "both.csv"}
    assert set(files) == set(tmp_path.iterdir())
    before = {path: path.read_bytes() for path in files}
    save(FIGURE, tmp_path)
    assert {path: path.read_bytes() for path in files} == before


def names(axes) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_axes_have_labels_and_limits():
    picture = draw(FIGURE)
    assert picture.axes[0].get_xlabel() == "time [s]"
    assert picture.axes[0].get_xlim() == pytest.approx((0.0, 0.4))
    assert picture.axes[1].get_yscale() == "log"


def test_every_panel_names_its_curves_inside_itself():
    picture = draw(FIGURE)
    picture.draw_without_rendering()
    assert not picture.legends
    assert [names(axes) for axes in picture.axes] == [["fast", "slow"], ["first"]]
    for axes in picture.axes:
        box, panel = axes.get_legend().get_window_extent(), axes.get_window_extent()
        assert panel.x0 <= box.x0 < box.x1 <= panel.x1
        assert panel.y0 <= box.y0 < box.y1 <= panel.y1


def test_a_panel_below_one_with_the_same_names_does_not_repeat_them():
    other = Panel("other", "Other", PANEL.x, PANEL.y, PANEL.curves[:1])
    first, second, third = draw(Figure("three", "", ((PANEL,), (PANEL,), (other,)), (5, 9))).axes
    assert names(first) == ["fast", "slow"]
    assert second.get_legend() is None
    assert names(third) == ["fast"]


def test_steps_hold_a_value_until_the_next_point():
    styles = [line.get_drawstyle() for line in draw(FIGURE).axes[0].get_lines()]
    assert styles == ["default", "steps-post", "default"]
