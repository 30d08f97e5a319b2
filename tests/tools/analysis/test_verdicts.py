"""The three verdicts: what makes each good, bad or null, from what both sides told."""

from __future__ import annotations

import math
from typing import Any

import pytest

from hoap3.tools.analysis.deadline_verdict import judge_counts, unknown_deadlines
from hoap3.tools.analysis.verdicts import (
    CERTIFIED_SHARE,
    deadline_words,
    failed,
    in_words,
    judge,
    judge_reported,
)

NOTHING_HELD = {"interventions": 0, "torque_limited": 0}


def counts(held_back: int | None, torque_limited: int | None) -> dict[str, Any]:
    return {"interventions": held_back, "torque_limited": torque_limited}


IN_TIME = unknown_deadlines("", "", "pass")
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
    judged = judge(IN_TIME, counts(held_back, weak), outcome)
    return judged["verdicts"][name], judged[name]["reasons"]


def test_a_margin_is_told_with_its_unit_and_what_it_is_of():
    margin = {"least": 0.25, "tolerance": 1e-6, "of": "ball: hand", "unit": "m"}
    words = in_words(judge(IN_TIME, NOTHING_HELD, told(margin=margin)))["limits_and_balance"]
    assert "0.25 m (ball: hand)" in words


def test_all_good():
    judged = judge(IN_TIME, NOTHING_HELD, told())
    good = {"deadlines": "pass", "task": "pass", "limits_and_balance": "pass"}
    assert judged["verdicts"] == good
    assert not failed(good)
    assert judged["task"]["certified_share"] == 1.0


@pytest.mark.parametrize(
    ("outcome", "expected"),
    [
        (told(tasks=[FAR]), ("fail", ["not_reached"])),
        (told(tasks=[{**ERROR, "error": None, "within": False}]), ("fail", ["not_reached"])),
        (told(tasks=[ERROR, LOWER]), ("pass", [])),
        (told(certified=949), ("fail", ["not_certified"])),
        (told(certified=950), ("pass", [])),
        (told(tasks=[FAR], certified=0), ("fail", ["not_reached", "not_certified"])),
        (told(certifiable=0, certified=0), ("pass", [])),
        (told(tasks=[]), ("not judged", ["no_target"])),
        (told(tasks=[], certifiable=0, certified=0), ("not judged", ["no_target"])),
        (told(tasks=[LOWER], certifiable=0, certified=0), ("not judged", ["no_target"])),
        (None, ("not judged", ["not_told_by_controller"])),
    ],
)
def test_the_task_on_both_sides_of_its_thresholds(outcome, expected):
    assert CERTIFIED_SHARE == 0.95
    assert verdict("task", outcome) == expected


@pytest.mark.parametrize(
    ("outcome", "counts", "expected"),
    [
        (told(), (1, 0), ("fail", ["held_back"])),
        (told(), (0, 1), ("fail", ["torque_limited"])),
        (told(margin={"least": -2e-9, "tolerance": 1e-9}), (), ("fail", ["margin_below_zero"])),
        (told(margin={"least": -1e-9, "tolerance": 1e-9}), (), ("pass", [])),
        (
            told(balance={"checked": 100, "outside": 1, "least_m": -0.01}),
            (),
            ("fail", ["com_outside_support"]),
        ),
        (told(balance=None), (), ("pass", [])),
        (None, (0, 0), ("not judged", ["not_told_by_controller"])),
        (None, (3, 0), ("fail", ["held_back", "not_told_by_controller"])),
    ],
)
def test_limits_and_balance_on_both_sides_of_their_thresholds(outcome, counts, expected):
    assert verdict("limits_and_balance", outcome, *counts) == expected


@pytest.mark.parametrize(
    ("verdicts", "code"),
    [
        (("pass", "pass", "pass"), False),
        (("warn", "not judged", "not judged"), False),
        (("not judged",) * 3, False),
        (("fail", "pass", "pass"), True),
        (("pass", "fail", "pass"), True),
        (("pass", "not judged", "fail"), True),
    ],
)
def test_one_that_fails_is_enough(verdicts, code):
    names = ("deadlines", "task", "limits_and_balance")
    assert failed(dict(zip(names, verdicts, strict=True))) == code


def test_words_have_the_figures_that_people_need():
    outside = {"checked": 100, "outside": 7, "least_m": -0.0121}
    outcome = told(tasks=[FAR, LOWER], certified=12, balance=outside)
    words = in_words(judge(IN_TIME, counts(4, 0), outcome))
    for part in ("com 15.4 m", "tolerance 1 mm", "12 of 1000", "hand", "lower priority"):
        assert part in words["task"]
    for part in ("4 periods", "12.1 mm outside", "7 of 100"):
        assert part in words["limits_and_balance"]


@pytest.mark.parametrize(
    ("held_back", "outcome", "silent", "verdict"),
    [
        (None, told(), {"robot"}, "not judged"),
        (0, None, {"controller"}, "not judged"),
        (3, None, {"controller"}, "fail"),
        (None, None, {"robot", "controller"}, "not judged"),
        (None, told(margin={"least": -1.0, "tolerance": 0.0}), {"robot"}, "fail"),
    ],
)
def test_limits_name_the_side_that_told_nothing(held_back, outcome, silent, verdict):
    judged = judge(IN_TIME, counts(held_back, held_back), outcome)
    limits = judged["limits_and_balance"]["reasons"]
    assert {side for side in ("robot", "controller") if f"not_told_by_{side}" in limits} == silent
    assert judged["verdicts"]["limits_and_balance"] == verdict
    words = in_words(judged)["limits_and_balance"]
    assert {side for side in ("robot", "controller") if f"from the {side}" in words} == silent


@pytest.mark.parametrize(
    "more", [{"misses": {"late": 2, "lost": 3}}, {"asked": 100, "in_time": 95}]
)
def test_missed_answers_are_named_where_joints_were_clipped(more):
    clipped, free = (
        judge(IN_TIME, {**counts(held_back, 0), **more}, told()) for held_back in (7, 0)
    )
    assert "missed answers: 5" in in_words(clipped)["limits_and_balance"]
    assert "answers" not in in_words(free)["limits_and_balance"]


def test_the_joints_that_were_held_back_are_named():
    joints = {"first": "knee", "first_tick": 12, "most": "hip", "most_periods": 3}
    judged = judge(IN_TIME, {**counts(4, 0), "held_back_joints": joints}, told())
    assert judged["limits_and_balance"]["held_back_joints"] == joints
    words = in_words(judged)["limits_and_balance"]
    for part in ("knee", "12", "hip", "3 periods"):
        assert part in words
    assert judge(IN_TIME, counts(4, 0), told())["limits_and_balance"]["held_back_joints"] is None


@pytest.mark.parametrize(
    ("at_start", "expected"),
    [(4, "pass"), (3, "fail"), (0, "fail"), (None, "fail"), (-1, "fail"), ("4", "fail")],
)
def test_only_what_was_clipped_after_the_start_fails(at_start, expected):
    limit = {"limit": "jerk", "value": 2000.0, "unit": "rad/s³"}
    told_by_robot = {"startup_interventions": at_start, "held_back_limit": limit}
    judged = judge(IN_TIME, {**counts(4, 0), **told_by_robot}, told())
    assert judged["verdicts"]["limits_and_balance"] == expected
    words = in_words(judged)["limits_and_balance"]
    for part in ("4 periods", "jerk limit of 2000 rad/s³", "setpoint_jerk_max"):
        assert part in words


def test_a_safe_stop_without_any_answer_fails():
    counts = {"asked": 0, "in_time": 0, "safe_stops": 1, "interventions": 0, "torque_limited": 0}
    assert judge_reported(counts, None)["verdicts"]["deadlines"] == "fail"
    nothing = judge_reported({**counts, "safe_stops": 0}, None)["verdicts"]
    assert set(nothing.values()) == {"not judged"}


def test_what_the_controller_should_have_told_is_bad_where_it_did_not():
    lost = judge(IN_TIME, NOTHING_HELD, None, expected=True)
    assert lost["verdicts"] == {"deadlines": "pass", "task": "fail", "limits_and_balance": "fail"}
    assert lost["task"]["reasons"] == ["not_told_by_controller"]
    assert failed(lost["verdicts"])
    no_target = judge(
        IN_TIME, NOTHING_HELD, told(tasks=[], certifiable=0, certified=0), expected=True
    )
    assert no_target["verdicts"]["task"] == "not judged"
    assert not failed(no_target["verdicts"])


@pytest.mark.parametrize(
    ("damaged", "timing", "outcome", "held_back", "expected"),
    [
        (("controller",), "pass", None, 0, ("pass", "fail", "fail")),
        (("controller",), "pass", told(), 0, ("pass", "pass", "pass")),
        (("robot",), "pass", told(), None, ("not judged", "pass", "fail")),
        (("robot",), "warn", told(), 0, ("not judged", "pass", "pass")),
        (("robot",), "fail", told(), 0, ("fail", "pass", "pass")),
        (("robot",), None, None, None, ("not judged", "not judged", "fail")),
    ],
)
def test_what_a_damaged_log_has_lost_is_never_good(damaged, timing, outcome, held_back, expected):
    given = None if timing is None else unknown_deadlines("", "", timing)
    judged = judge(given, counts(held_back, held_back), outcome, damaged=damaged)
    assert tuple(judged["verdicts"].values()) == expected
    for name in ("task", "limits_and_balance"):
        lost = judged["verdicts"][name] == "fail"
        assert judged[name]["reasons"].count("damaged") == lost


def test_a_margin_that_is_not_a_number_is_a_violation():
    for margin in ({"least": math.nan, "tolerance": 0.0}, {"least": 1.0, "tolerance": math.nan}):
        judged = judge(IN_TIME, counts(0, 0), told(margin=margin))
        assert judged["verdicts"]["limits_and_balance"] == "fail"


def test_a_safe_stop_without_a_miss_gets_no_invented_cause():
    reported = {"asked": 100, "in_time": 100, "worst_window": 1.0, "safe_stops": 1}
    found = judge_counts(reported)
    assert (found["verdict"], found["cause"], found["remedy"]) == ("fail", None, None)


def test_words_say_what_is_not_usual():
    assert deadline_words({"deadline": "next_tick", "delay_ticks": 0}) is None
    assert deadline_words({"deadline": "after_receipt", "delay_ticks": 0}) == (
        "a period after the publication of its State"
    )
    assert deadline_words({"deadline": "next_tick", "delay_ticks": 3}) == (
        "4 periods after the begin of its tick; applied 3 ticks later"
    )
