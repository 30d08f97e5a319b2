"""What is written as CSV is what is drawn, and people can read what is drawn."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from hoap3.tools.reproduce.figures import COLOURS, Axis, Curve, Figure, Panel, draw, save
from hoap3.tools.reproduce.papers.qp12 import drawings

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


def names(axes) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_axes_have_labels_and_limits():
    picture = draw(FIGURE)
    assert picture.axes[0].get_xlabel() == "time [s]"
    assert picture.axes[0].get_xlim() == pytest.approx((0.0, 0.4))
    assert picture.axes[1].get_yscale() == "log"


def assert_free(axes):
    """The legend lies in its panel, and no curve, sampled finely, has a point in it."""
    box, panel = axes.get_legend().get_window_extent(), axes.get_window_extent()
    assert panel.x0 <= box.x0 < box.x1 <= panel.x1
    assert panel.y0 <= box.y0 < box.y1 <= panel.y1
    for line in axes.get_lines():
        points = axes.transData.transform(line.get_xydata())
        if line.get_drawstyle() == "steps-post":
            corners = np.column_stack((points[1:, 0], points[:-1, 1]))
            points = np.insert(points, np.arange(1, len(points)), corners, axis=0)
        if line.get_linestyle() != "None":
            shares = np.linspace(0.0, 1.0, 200)[:, None, None]
            points = (points[:-1] + shares * (points[1:] - points[:-1])).reshape(-1, 2)
        inside = (points > box.min).all(axis=1) & (points < box.max).all(axis=1)
        assert not inside.any()


def test_every_panel_names_its_curves_inside_itself():
    picture = draw(FIGURE)
    picture.draw_without_rendering()
    assert not picture.legends
    assert [names(axes) for axes in picture.axes] == [["fast", "slow"], ["first"]]
    for axes in picture.axes:
        assert_free(axes)


def test_a_panel_below_one_with_the_same_names_does_not_repeat_them():
    other = Panel("other", "Other", PANEL.x, PANEL.y, PANEL.curves[:1])
    first, second, third = draw(Figure("three", "", ((PANEL,), (PANEL,), (other,)), (5, 9))).axes
    assert names(first) == ["fast", "slow"]
    assert second.get_legend() is None
    assert names(third) == ["fast"]


def wild(seed: int, count: int, style: str) -> Panel:
    """Curves through all of a panel."""
    rng, x = np.random.default_rng(seed), np.linspace(0.0, 1.0, 60)
    curves = [
        Curve(f"curve {k} of {count}", x, rng.uniform(-1.0, 1.0, 60), COLOURS[k % 7], style)
        for k in range(count)
    ]
    return Panel("wild", "Wild", Axis("x", "x"), Axis("y", "y"), curves)


@pytest.mark.parametrize("style", ["line", "steps"])
def test_where_curves_are_everywhere_the_panel_becomes_higher(style):
    panel = wild(3, 7, style)
    picture = draw(Figure("wild", "Wild", ((panel,),), (5.0, 3.0)))
    picture.draw_without_rendering()
    (axes,) = picture.axes
    assert len(names(axes)) == 7
    assert_free(axes)
    top = max(curve.y.max() for curve in panel.curves)
    assert axes.get_ylim()[1] > 1.1 * top


def over_the_sole() -> Panel:
    t = np.linspace(0.0, 1.0, 100)
    paths = {f"γ = {k}": (-8.4 + 18.4 * t, 27.9 - 2.9 * t**k) for k in range(1, 7)}
    curves = [drawings.sole_outline(), *drawings.lines(paths)]
    zoom = (-11.0, 13.0), (23.0, 30.0)
    return drawings.over_the_sole("", "", (-60.0, 60.0), (-42.0, 42.0), curves, zoom)


def one_above_the_other() -> Panel:
    x = np.linspace(0.0, 1.0, 50)
    curves = (Curve("a long name of a curve", x, x + 1.0), Curve("another one", x, x + 0.9))
    return Panel("", "", Axis("x", "x"), Axis("y", "y"), curves, zoom=((0.4, 0.5), (1.3, 1.6)))


@pytest.mark.parametrize("panel", [one_above_the_other, over_the_sole])
def test_a_legend_keeps_away_from_what_is_shown_larger(panel):
    picture = draw(Figure("zoom", "", ((panel(),),), (5.0, 4.0)))
    picture.draw_without_rendering()
    (axes,) = [each for each in picture.axes if each.get_legend()]
    assert_free(axes)
    (inset,) = axes.child_axes
    assert not axes.get_legend().get_window_extent().overlaps(inset.get_tightbbox())


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
