"""A row passes where ours is what it should be, and never because nothing was found."""

from __future__ import annotations

import math

import pytest

from hoap3.tools.reproduce.rows import between, bounded, measured, near


@pytest.mark.parametrize(
    ("ours", "passed"),
    [(0.445, True), (0.4537, True), (0.4363, True), (0.4541, False), (0.4359, False)],
)
def test_two_percent_of_the_reference_are_allowed(ours, passed):
    assert near("V", "about 0", ours, 0.445, "why").passed is passed


def test_a_negative_reference_has_a_width_too():
    row = near("x", -0.0085, -0.0084, -0.0085, "why")
    assert row.passed is True
    assert row.tolerance[0] < row.tolerance[1]


def test_an_absolute_tolerance_replaces_the_relative_one():
    assert near("share", None, 0.264, 0.27, "why", absolute=0.01).passed is True
    assert near("share", None, 0.264, 0.27, "why").passed is False


@pytest.mark.parametrize(
    ("ours", "passed"), [(0.0167, True), (0.0204, True), (0.0166, False), (0.0205, False)]
)
def test_a_range_is_widened_by_two_percent_at_either_end(ours, passed):
    assert between("V", None, ours, (0.017, 0.020), "why").passed is passed


def test_bounds_may_be_open():
    assert bounded("u", None, -1e9, (None, 1.0), "why").passed is True
    assert bounded("u", None, 1.1, (None, 1.0), "why").passed is False
    assert bounded("u", None, 1e9, (1.0, None), "why").passed is True


def test_a_measurement_neither_passes_nor_fails():
    row = measured("time", 1.358, 0.7, "why", unit="us")
    assert row.passed is None
    assert row.as_json()["tolerance"] is None


def test_what_was_not_found_fails_and_is_null():
    row = near("time", None, math.nan, 598, "why")
    assert row.passed is False
    assert row.as_json()["ours"] is None
    assert row.as_json()["pass"] is False
