"""The three verdicts: what makes each good, bad or null, from what both sides told."""

from __future__ import annotations

from typing import Any

import pytest

from hoap3.tools.show.verdicts import CERTIFIED_SHARE, failed, in_words, judge

ERROR = {
    "task": "com", "error": 5e-4, "unit": "m", "tolerance": 1e-3, "within": True,
    "judged": True, "note": "",
}  # fmt: skip
FAR = {**ERROR, "error": 15.4, "within": False}
LOWER = {**FAR, "task": "hand", "judged": False, "note": "lower priority"}


def told(**changes: Any) -> dict[str, Any]:
    """What a controller tells of a run in which all went well."""
    good = {"tasks": [ERROR], "certifiable": 1000, "certified": 1000, "margin": None}
    return {**good, "balance": {"checked": 100, "outside": 0, "least_m": 0.008}, **changes}


def verdict(name: str, outcome: dict[str, Any] | None, held_back: int = 0, weak: int = 0):
    judged = judge("fit", held_back, weak, outcome)
    return judged["verdicts"][name], judged[name]["reasons"]


def test_a_margin_is_told_with_its_unit_and_what_it_is_of():
    margin = {"least": 0.25, "tolerance": 1e-6, "of": "ball: hand", "unit": "m"}
    words = in_words(judge("fit", 0, 0, told(margin=margin)))["limits_and_balance"]
    assert "0.25 m (ball: hand)" in words


def test_all_good():
    judged = judge("fit", 0, 0, told())
    good = {"deadlines": "fit", "task": "good", "limits_and_balance": "good"}
    assert judged["verdicts"] == good
    assert not failed(good)
    assert judged["task"]["certified_share"] == 1.0


@pytest.mark.parametrize(
    ("outcome", "expected"),
    [
        (told(tasks=[FAR]), ("bad", ["not_reached"])),
        (told(tasks=[{**ERROR, "error": None, "within": False}]), ("bad", ["not_reached"])),
        (told(tasks=[ERROR, LOWER]), ("good", [])),
        (told(certified=949), ("bad", ["not_certified"])),
        (told(certified=950), ("good", [])),
        (told(tasks=[FAR], certified=0), ("bad", ["not_reached", "not_certified"])),
        (told(certifiable=0, certified=0), ("good", [])),
        (told(tasks=[]), ("good", [])),
        (told(tasks=[], certifiable=0, certified=0), (None, ["no_target"])),
        (told(tasks=[LOWER], certifiable=0, certified=0), (None, ["no_target"])),
        (None, (None, ["not_told_by_controller"])),
    ],
)
def test_the_task_on_both_sides_of_its_thresholds(outcome, expected):
    assert CERTIFIED_SHARE == 0.95
    assert verdict("task", outcome) == expected


@pytest.mark.parametrize(
    ("outcome", "counts", "expected"),
    [
        (told(), (1, 0), ("bad", ["held_back"])),
        (told(), (0, 1), ("bad", ["torque_limited"])),
        (told(margin={"least": -2e-9, "tolerance": 1e-9}), (), ("bad", ["margin_below_zero"])),
        (told(margin={"least": -1e-9, "tolerance": 1e-9}), (), ("good", [])),
        (
            told(balance={"checked": 100, "outside": 1, "least_m": -0.01}),
            (),
            ("bad", ["com_outside_support"]),
        ),
        (told(balance=None), (), ("good", [])),
        (None, (0, 0), (None, ["not_told_by_controller"])),
        (None, (3, 0), ("bad", ["held_back", "not_told_by_controller"])),
    ],
)
def test_limits_and_balance_on_both_sides_of_their_thresholds(outcome, counts, expected):
    assert verdict("limits_and_balance", outcome, *counts) == expected


@pytest.mark.parametrize(
    ("verdicts", "code"),
    [
        (("fit", "good", "good"), False),
        (("warn", None, None), False),
        ((None, None, None), False),
        (("unfit", "good", "good"), True),
        (("fit", "bad", "good"), True),
        (("fit", None, "bad"), True),
    ],
)
def test_one_that_fails_is_enough(verdicts, code):
    names = ("deadlines", "task", "limits_and_balance")
    assert failed(dict(zip(names, verdicts, strict=True))) == code


def test_words_have_the_figures_that_people_need():
    outside = {"checked": 100, "outside": 7, "least_m": -0.0121}
    outcome = told(tasks=[FAR, LOWER], certified=12, balance=outside)
    words = in_words(judge("fit", 4, 0, outcome))
    for part in ("com 15.4 m", "tolerance 1 mm", "12 of 1000", "hand", "lower priority"):
        assert part in words["task"]
    for part in ("4 periods", "12.1 mm outside", "7 of 100"):
        assert part in words["limits_and_balance"]


@pytest.mark.parametrize(
    ("held_back", "outcome", "silent", "verdict"),
    [
        (None, told(), {"robot"}, None),
        (0, None, {"controller"}, None),
        (3, None, {"controller"}, "bad"),
        (None, None, {"robot", "controller"}, None),
        (None, told(margin={"least": -1.0, "tolerance": 0.0}), {"robot"}, "bad"),
    ],
)
def test_limits_name_the_side_that_told_nothing(held_back, outcome, silent, verdict):
    judged = judge("fit", held_back, held_back, outcome)
    limits = judged["limits_and_balance"]["reasons"]
    assert {side for side in ("robot", "controller") if f"not_told_by_{side}" in limits} == silent
    assert judged["verdicts"]["limits_and_balance"] == verdict
    words = in_words(judged)["limits_and_balance"]
    assert {side for side in ("robot", "controller") if f"told by the {side}" in words} == silent


def test_the_joints_that_were_held_back_are_named():
    joints = {"first": "knee", "first_tick": 12, "most": "hip", "most_periods": 3}
    judged = judge("fit", 4, 0, told(), joints=joints)
    assert judged["limits_and_balance"]["held_back_joints"] == joints
    words = in_words(judged)["limits_and_balance"]
    for part in ("knee", "12", "hip", "3 periods"):
        assert part in words
    assert judge("fit", 4, 0, told())["limits_and_balance"]["held_back_joints"] is None


def test_what_the_controller_should_have_told_is_bad_where_it_did_not():
    lost = judge("fit", 0, 0, None, expected=True)
    assert lost["verdicts"] == {"deadlines": "fit", "task": "bad", "limits_and_balance": "bad"}
    assert lost["task"]["reasons"] == ["not_told_by_controller"]
    assert failed(lost["verdicts"])
    no_target = judge("fit", 0, 0, told(tasks=[], certifiable=0, certified=0), expected=True)
    assert no_target["verdicts"]["task"] is None
    assert not failed(no_target["verdicts"])


@pytest.mark.parametrize(
    ("damaged", "deadlines", "outcome", "held_back", "expected"),
    [
        (("controller",), "fit", None, 0, ("fit", "bad", "bad")),
        (("controller",), "fit", told(), 0, ("fit", "good", "good")),
        (("robot",), "fit", told(), None, (None, "good", "bad")),
        (("robot",), "warn", told(), 0, (None, "good", "good")),
        (("robot",), "unfit", told(), 0, ("unfit", "good", "good")),
        (("robot",), None, None, None, (None, None, "bad")),
    ],
)
def test_what_a_damaged_log_has_lost_is_never_good(
    damaged, deadlines, outcome, held_back, expected
):
    judged = judge(deadlines, held_back, held_back, outcome, damaged=damaged)
    assert tuple(judged["verdicts"].values()) == expected
    for name in ("task", "limits_and_balance"):
        lost = judged["verdicts"][name] == "bad"
        assert judged[name]["reasons"].count("damaged") == lost
