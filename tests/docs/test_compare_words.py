"""docs/compare.md defines every figure of a comparison, and shows what was measured."""

from __future__ import annotations

import re

import pytest
from pages import prose, table

from hoap3.tools.compare.comparison import compare
from hoap3.tools.compare.figures import WORDS, value

PAGE = "compare.md"
EXAMPLE = [
    *("qp12_paper@gamma=0", "qp12_paper@gamma=0.5", "qp12_paper@gamma=0.99"),
    *("pinv@ramp_s=0", "osqp@ramp_s=0,adaptive_gamma=false"),
]
ROWS = {
    "error at the end [mm]": ("error.end", 1e3),
    "to 1 % of the start [s]": ("error.settled_s", 1.0),
    "V, unlike the first": ("v_difference", 1.0),
    "∫ \\|u\\|₁ [rad]": ("control_effort.l1", 1.0),
    "∫ \\|u\\|² [rad²/s]": ("control_effort.l2", 1.0),
    "path of the centre of mass [mm]": ("path.com_m", 1e3),
    "active joints, mean": ("active_joints.mean", 1.0),
    "switching [1/s]": ("switching_per_s", 1.0),
    "uncertified of 20,000": ("certificates.uncertified", 1.0),
}


def test_every_figure_is_defined_once():
    rows = table(PAGE, "Figures")
    written = [key for row in rows for key in re.findall(r"`([\w.]+)`", row["in the JSON"])]
    assert sorted(written) == sorted([*(word.key for word in WORDS), "unit"])


def test_the_page_says_what_an_open_loop_has():
    made = compare(["qp12", "pinv"], duration=0.05, timing=False)
    has = {word.key for word in WORDS if value(made.figures[0], word.key) is not None}
    for row in table(PAGE, "Figures"):
        keys = re.findall(r"`([\w.]+)`", row["in the JSON"])
        if row["open loop"] == "only":
            assert not has & {*keys}
        else:
            assert {*keys} <= has | {"error.settled_s", "unit"}


def test_keys_around_the_figures_are_named():
    made = compare(["qp12", "pinv"], duration=0.05)
    whole = {**made.as_json(), "timing": made.timing, "files": []}
    for key in (*whole, "label", "controller", "parameters"):
        assert f"`{key}`" in prose(PAGE), key
    for key in (*made.timing, *(f"rows[].{key}" for key in made.timing["rows"][0])):
        assert key == "rows" or f"`{key}`" in prose(PAGE), key


def number(cell: str) -> float:
    digits, _, power = cell.partition("·10")
    return float(digits) * 10.0 ** int(power.translate(str.maketrans("⁻⁹", "-9")) or 0)


@pytest.mark.long
def test_the_example_shows_what_comes_out():
    made = compare(EXAMPLE, timing=False)
    rows = {next(iter(row.values())): list(row.values())[1:] for row in table(PAGE, "An example")}
    for name, (key, scale) in ROWS.items():
        for cell, found in zip(rows[name], made.figures, strict=True):
            expected = scale * value(found, key)
            close = abs(number(cell) - expected) <= 0.05 * abs(expected) + 1e-12
            assert close, (name, cell, expected)
