"""Each row is of one class by its data, and passes only where ours is what it should be."""

from __future__ import annotations

import json
import math

import pytest

from hoap3.tools.reproduce.rows import (
    CLASSES,
    CONFIRMED,
    MEASURED,
    NOT_REPRODUCED,
    REPRODUCED,
    count,
    like,
    row,
)


@pytest.mark.parametrize(
    ("paper", "ours", "kind"),
    [
        (400, 440.0, REPRODUCED),
        (400, 441.0, NOT_REPRODUCED),
        (18, 16.1, NOT_REPRODUCED),
        (18, 16.2, REPRODUCED),
        (3, 2.5, REPRODUCED),  # rounds to what is printed
        (-1.4, -1.3, REPRODUCED),
        (-1.4, 1.4, NOT_REPRODUCED),
        ("1.0e-6", 1.2e-6, NOT_REPRODUCED),
        ("1e-6", 1.4e-6, REPRODUCED),
        ("0.3", 0.349, REPRODUCED),
        ("0.30", 0.349, NOT_REPRODUCED),
        ("1 to 2", 2.2, REPRODUCED),
        ("1 to 2", 2.3, NOT_REPRODUCED),
        (400, math.nan, NOT_REPRODUCED),
    ],
)
def test_a_printed_number_is_reproduced_within_10_percent_or_its_digits(paper, ours, kind):
    assert row("x", paper, ours, None, "why").kind == kind


@pytest.mark.parametrize("paper", [0, 1, -1, 0.0, 1.0, "0", "violated", "at most 6", None])
def test_zero_one_and_words_are_claims(paper):
    found = row("x", paper, 0.5, (0.0, 1.0), "why")
    assert (found.kind, found.passed) == (CONFIRMED, True)
    assert row("x", paper, 2.0, (0.0, 1.0), "why").passed is False


def test_a_printed_number_that_is_not_reproduced_needs_an_explanation():
    assert row("x", 400, 2744.0, None, "why").passed is False
    found = row("x", 400, 2744.0, None, "why", differs="another unit")
    assert (found.passed, found.note) == (None, "another unit")
    assert row("x", 400, math.nan, None, "why", differs="another unit").passed is False
    found = row("x", 400, 400.0, None, "why", differs="another unit")
    assert (found.passed, found.note, found.as_json()["differs"]) == (True, "why", "")


def test_a_number_as_printed_that_is_not_the_oracles_fails():
    found = row("x", 400, 400.0, like(464.0), "why", differs="another unit")
    assert (found.kind, found.passed) == (REPRODUCED, False)
    assert row("x", 400, 464.0, like(464.0), "why", differs="another unit").passed is None


def test_a_time_of_this_machine_is_measured_only_whatever_the_paper_prints():
    for ours in (0.7, 1.358):
        found = row("time", 1.358, ours, None, "why", unit="us", timed=True)
        assert (found.kind, found.passed) == (MEASURED, None)
    assert row("x", None, 3.0, None, "why").kind == MEASURED
    assert row("x", 3.0, 3.0, None, "why").kind == REPRODUCED


def test_counts_are_those_of_the_classes():
    rows = [
        row("a", 2.0, 2.0, None, "why", fitted="target"),
        row("b", 2.0, 2.1, None, "why"),
        row("c", 2.0, 3.0, None, "why", differs="another"),
        row("d", 2.0, 3.0, None, "why"),
        row("e", 0, 0.0, (0.0, 0.0), "why"),
        row("f", None, 2.0, (None, 1.0), "why"),
        row("g", None, 1.0, None, "why"),
    ]
    found = count(rows)
    assert [found[kind] for kind in CLASSES] == [2, 2, 2, 1]
    assert sum(found[kind] for kind in CLASSES) == len(rows)
    assert found["of these reproduced with fitted inputs"] == 1
    assert found["failed"] == 2


@pytest.mark.parametrize(
    ("ours", "passed"),
    [(0.445, True), (0.4537, True), (0.4363, True), (0.4541, False), (0.4359, False)],
)
def test_two_percent_of_the_reference_are_allowed(ours, passed):
    assert row("V", "about 0", ours, like(0.445), "why").passed is passed


def test_a_negative_reference_has_a_width_too():
    found = row("x", None, -0.0085, like(-0.0085), "why")
    assert found.passed is True
    assert found.tolerance[0] < found.tolerance[1]


def test_an_absolute_tolerance_replaces_the_relative_one():
    assert row("share", None, 0.264, like(0.27, 0.01), "why").passed is True
    assert row("share", None, 0.264, like(0.27), "why").passed is False


def test_bounds_may_be_open():
    assert row("u", None, -1e9, (None, 1.0), "why").passed is True
    assert row("u", None, 1.1, (None, 1.0), "why").passed is False
    assert row("u", None, 1e9, (1.0, None), "why").passed is True


def test_what_was_not_found_fails_and_is_null():
    found = row("time", None, math.nan, like(598), "why")
    assert found.passed is False
    assert found.as_json()["ours"] is None
    assert found.as_json()["pass"] is False
    assert json.dumps(found.as_json(), allow_nan=False)


def test_json_has_numbers_where_the_paper_has():
    assert row("x", "1.0e-6", 1e-6, None, "why").as_json()["paper"] == 1e-6
    assert row("x", "violated", 1.0, (0.0, None), "why").as_json()["paper"] == "violated"
    assert row("x", None, 1.0, None, "why").as_json()["paper"] is None
    assert row("x", None, 1.0, None, "why").as_json()["class"] == MEASURED
