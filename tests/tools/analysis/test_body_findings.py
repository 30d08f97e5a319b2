"""Limits and balance are not good where joints left their stops, or the base fell."""

from __future__ import annotations

import math
from typing import Any

import pytest

from hoap3.tools.analysis.body_findings import body_of
from hoap3.tools.analysis.deadline_verdict import unknown_deadlines
from hoap3.tools.analysis.summary import plant_rows
from hoap3.tools.analysis.verdicts import judge

NOTHING_HELD = {"interventions": 0, "torque_limited": 0}

IN_TIME = unknown_deadlines("", "", "pass")
TOLD = {"tasks": [], "certifiable": 0, "certified": 0, "margin": None, "balance": None}
STOPS = {
    "periods": 4900, "first": "RHand", "first_tick": 62, "furthest": "LHand",
    "furthest_by": 16.4, "unit": "rad",
}  # fmt: skip
BASE = {"tilt_deg": 3.0, "largest_tilt_deg": 44.9, "fallen_tick": None, "moved_m": [0.0, 0.1, -0.2]}
FALLEN = {**BASE, "largest_tilt_deg": 178.0, "fallen_tick": 410}


def limits(summary: dict[str, Any]) -> dict[str, Any]:
    return judge(IN_TIME, {**NOTHING_HELD, **summary}, TOLD)


@pytest.mark.parametrize(
    ("summary", "expected"),
    [
        ({}, ("pass", [])),
        ({"beyond_stops": None, "base": None}, ("pass", [])),
        ({"beyond_stops": None, "base": BASE}, ("pass", [])),
        ({"beyond_stops": STOPS}, ("fail", ["beyond_stops"])),
        ({"base": FALLEN}, ("fail", ["fallen"])),
        ({"beyond_stops": STOPS, "base": FALLEN}, ("fail", ["beyond_stops", "fallen"])),
    ],
)
def test_limits_and_balance_rest_on_what_was_measured(summary, expected):
    judged = limits(summary)
    found = judged["verdicts"]["limits_and_balance"], judged["limits_and_balance"]["reasons"]
    assert found == expected


@pytest.mark.parametrize(
    "summary",
    [
        {"beyond_stops": 3},
        {"beyond_stops": {**STOPS, "periods": "many"}},
        {"beyond_stops": {**STOPS, "furthest_by": math.nan}},
        {"base": {**FALLEN, "moved_m": [0.0, 1.0]}},
        {"base": {**FALLEN, "moved_m": [0.0, 1.0, "far"]}},
        {"base": {key: value for key, value in FALLEN.items() if key != "tilt_deg"}},
    ],
)
def test_a_strange_log_does_not_tell(summary):
    assert set(body_of(summary).values()) == {None}


def test_a_robot_without_soles_has_a_line_for_its_base_and_its_centre_of_mass():
    rows = dict(plant_rows({"com_world_m": [0.1, 0.0, 0.25]}, BASE))
    assert {"base", "plant"} <= rows.keys()
    for part in ("44.9", "0.1", "-0.2"):
        assert part in rows["base"]
    assert "250" in rows["plant"]
