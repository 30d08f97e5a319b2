"""Conditions are counted in a table of their own, and leave the list of events to the rest."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.html_page import Page
from support.log_samples import MS, START, describe, fill, write

from hoap3.protocol.messages import Event, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.analysis.report.content import read_content
from hoap3.tools.analysis.report.events import read_intervals, sum_up_conditions
from hoap3.tools.analysis.report.page import page
from hoap3.tools.logs.log import Log

EVENTS = Event.schema.constants
NAMES = ("slowed", "infeasible_constraints", "held by <zmp>")


def controllers_log(folder, present, session=7):
    """Log of a controller: the numbers of the conditions that hold in each tick from 10 on."""
    description, rng, before = describe(2), np.random.default_rng(0), set()
    session_facts = {"side": "controller", "session_id": session, "conditions": NAMES}
    records = [
        Record(Kind.DESCRIPTION, START - 2, description.to_json()),
        Record(Kind.SESSION, START - 1, json.dumps(session_facts).encode()),
    ]
    for tick, now in enumerate(present, 10):
        at = START + tick * MS
        given = {"session_id": session, "tick": tick, "mode": State.ACTIVE, "stamp_intended": at}
        records.append(Record(Kind.STATE, at, fill(State(2), rng, **given)))
        for number in sorted(now ^ before):
            event = Event()
            event.kind = EVENTS["CONDITION_BEGAN" if number in now else "CONDITION_ENDED"]
            event.session_id, event.tick, event.stamp = session, tick, at
            event.detail = number
            records.append(Record(Kind.EVENT, at, event.dump()))
        before = now
    about = {"attachments": {"description.json": description.to_json()}}
    write(folder / "controller.mcap", records, side="controller", **about)
    return folder


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    present = [set(), {0}, {0, 1}, {0}, set(), {0, 2}, {0, 2}, {2}]
    return read_content(controllers_log(tmp_path_factory.mktemp("conditions"), present))


def test_json_has_times_ticks_the_first_and_the_longest(content):
    assert content.as_json()["conditions"] == [
        {"condition": "slowed", "times": 2, "ticks": 5, "first_tick": 11, "longest": 3},
        {"condition": "held by <zmp>", "times": 1, "ticks": 3, "first_tick": 15, "longest": 3},
        {
            "condition": "infeasible_constraints",
            "times": 1,
            "ticks": 1,
            "first_tick": 12,
            "longest": 1,
        },
    ]


def test_the_page_has_them_as_tables_with_begin_and_end_and_not_as_events(content):
    shown = Page(page(content))
    assert shown.rows("conditions") == [
        ["condition", "times", "ticks in all", "first tick", "longest"],
        ["slowed", "2", "5", "11", "3"],
        ["held by <zmp>", "1", "3", "15", "3"],
        ["infeasible_constraints", "1", "1", "12", "1"],
    ]
    assert shown.rows("conditions", 1) == [
        ["condition", "begin (tick)", "begin [s]", "end [s]", "duration [s]"],
        ["slowed", "11", "0.001", "0.004", "0.003"],
        ["infeasible_constraints", "12", "0.002", "0.003", "0.001"],
        ["held by <zmp>", "15", "0.005", "until the end of the log", "0.003"],
        ["slowed", "15", "0.005", "0.007", "0.002"],
    ]
    assert "events" not in shown.sections()


@pytest.mark.slow
def test_without_any_there_is_no_section(tmp_path, story):
    still = read_content(controllers_log(tmp_path, [set()] * 3))
    assert still.as_json()["conditions"] == []
    assert "conditions" not in Page(page(still)).sections()
    shutil.copy(story[0] / "robot.mcap", tmp_path / "robot.mcap")
    alone = read_content(tmp_path / "robot.mcap")
    assert alone.as_json()["conditions"] is None
    assert "conditions" not in Page(page(alone)).sections()


def test_those_of_another_session_do_not_count(tmp_path):
    log = Log.open(controllers_log(tmp_path, [{1}] * 4, session=9))
    assert read_intervals(log, 8) == []
    (found,) = sum_up_conditions(read_intervals(log, 9))
    assert (found.condition, found.ticks) == ("infeasible_constraints", 4)


@settings(max_examples=15)
@given(present=st.lists(st.sets(st.integers(0, 3)), min_size=1, max_size=30))
def test_ticks_are_those_in_which_it_held(present, tmp_path_factory):
    log = Log.open(controllers_log(tmp_path_factory.mktemp("log"), present))
    intervals = read_intervals(log)
    found = {each.condition: each for each in sum_up_conditions(intervals)}
    for number, name in enumerate((*NAMES, "condition 3")):
        held = [number in each for each in present]
        assert (name in found) == any(held)
        if any(held):
            runs = [len(run) for run in "".join("01"[each] for each in held).split("0") if run]
            condition = found[name]
            assert (condition.times, condition.ticks) == (len(runs), sum(held))
            assert (condition.first_tick, condition.longest) == (10 + held.index(True), max(runs))
            mine = [each for each in intervals if each.condition == name]
            assert [each.ticks for each in mine] == runs
            assert [each.goes_on for each in mine] == [False] * (len(runs) - 1) + [held[-1]]
            ticks = {tick for each in mine for tick in range(each.begin, each.end)}
            assert ticks == {10 + place for place, holds in enumerate(held) if holds}
