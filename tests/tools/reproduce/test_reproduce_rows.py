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
    bounded,
    count,
    measured,
    near,
    printed,
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
    assert printed("x", paper, ours, "why").kind == kind


@pytest.mark.parametrize("paper", [0, 1, -1, 0.0, 1.0, "0", "violated", "at most 6", None])
def test_zero_one_and_words_are_claims(paper):
    row = bounded("x", paper, 0.5, (0.0, 1.0), "why")
    assert (row.kind, row.passed) == (CONFIRMED, True)
    assert bounded("x", paper, 2.0, (0.0, 1.0), "why").passed is False


def test_a_printed_number_that_is_not_reproduced_needs_an_explanation():
    assert printed("x", 400, 2744.0, "why").passed is False
    row = printed("x", 400, 2744.0, "why", differs="another unit")
    assert (row.passed, row.note) == (None, "another unit")
    assert printed("x", 400, math.nan, "why", differs="another unit").passed is False
    found = printed("x", 400, 400.0, "why", differs="another unit")
    assert (found.passed, found.note, found.as_json()["differs"]) == (True, "why", "")


def test_a_number_as_printed_that_is_not_the_oracles_fails():
    row = near("x", 400, 400.0, 464.0, "why", differs="another unit")
    assert (row.kind, row.passed) == (REPRODUCED, False)
    assert near("x", 400, 464.0, 464.0, "why", differs="another unit").passed is None


def test_a_time_of_this_machine_is_measured_only_whatever_the_paper_prints():
    for ours in (0.7, 1.358):
        row = measured("time", 1.358, ours, "why", unit="us", timed=True)
        assert (row.kind, row.passed) == (MEASURED, None)
    assert measured("x", None, 3.0, "why").kind == MEASURED
    assert measured("x", 3.0, 3.0, "why").kind == REPRODUCED


def test_counts_are_those_of_the_classes():
    rows = [
        printed("a", 2.0, 2.0, "why", fitted="target"),
        printed("b", 2.0, 2.1, "why"),
        printed("c", 2.0, 3.0, "why", differs="another"),
        printed("d", 2.0, 3.0, "why"),
        bounded("e", 0, 0.0, (0.0, 0.0), "why"),
        bounded("f", None, 2.0, (None, 1.0), "why"),
        measured("g", None, 1.0, "why"),
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
    assert near("V", "about 0", ours, 0.445, "why").passed is passed


def test_a_negative_reference_has_a_width_too():
    row = near("x", None, -0.0085, -0.0085, "why")
    assert row.passed is True
    assert row.tolerance[0] < row.tolerance[1]


def test_an_absolute_tolerance_replaces_the_relative_one():
    assert near("share", None, 0.264, 0.27, "why", absolute=0.01).passed is True
    assert near("share", None, 0.264, 0.27, "why").passed is False


def test_bounds_may_be_open():
    assert bounded("u", None, -1e9, (None, 1.0), "why").passed is True
    assert bounded("u", None, 1.1, (None, 1.0), "why").passed is False
    assert bounded("u", None, 1e9, (1.0, None), "why").passed is True


def test_what_was_not_found_fails_and_is_null():
    row = near("time", None, math.nan, 598, "why")
    assert row.passed is False
    assert row.as_json()["ours"] is None
    assert row.as_json()["pass"] is False
    assert json.dumps(row.as_json(), allow_nan=False)


def test_json_has_numbers_where_the_paper_has():
    assert printed("x", "1.0e-6", 1e-6, "why").as_json()["paper"] == 1e-6
    assert bounded("x", "violated", 1.0, (0.0, None), "why").as_json()["paper"] == "violated"
    assert measured("x", None, 1.0, "why").as_json()["paper"] is None
    assert measured("x", None, 1.0, "why").as_json()["class"] == MEASURED
