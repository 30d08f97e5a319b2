"""Answers are counted by what was proved of them, with what held meanwhile."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.analysis.certificates import (
    CertificateCount,
    CountingRecorder,
    in_a_line,
    reasons_on_wire,
)
from hoap3.tools.services.run_statistics import RunStatistics

CERTIFIED, AT_TARGET, UNCERTIFIED, INFEASIBLE, NONE = range(5)
STATUSES = ["certified", "at_target", "uncertified", "infeasible"]
NAMES = (
    "slowed",
    "infeasible_constraints",
    "cannot_descend",
    "beta below a tenth of what was asked",
)
EVENTS = Event.schema.constants
MS = 1_000_000


def session(number=7):
    facts = {"side": "controller", "session_id": number, "conditions": NAMES}
    return Record(Kind.SESSION, 0, json.dumps(facts).encode())


def answer(status, tick=0, number=7, epoch=1):
    setpoint = Setpoint(1)
    setpoint.session_id, setpoint.tick, setpoint.solver_status = number, tick, status
    setpoint.epoch = epoch
    return Record(Kind.SETPOINT, 0, setpoint.dump())


def condition(place, began, number=7):
    event = Event()
    event.kind = EVENTS["CONDITION_BEGAN" if began else "CONDITION_ENDED"]
    event.session_id, event.detail = number, place
    return Record(Kind.EVENT, 0, event.dump())


def figures(*records, of=None):
    count = CertificateCount(of)
    for record in records:
        count.add(record)
    return count.figures()


@given(
    cycles=st.lists(
        st.tuples(st.sampled_from([0, 1, 2, 3]), st.sets(st.integers(0, 2))), min_size=1
    )
)
def test_reasons_are_what_held_during_answers_without_certificate(cycles):
    records, before = [session()], set()
    for status, present in cycles:
        records += [condition(place, place in present) for place in sorted(before ^ present)]
        records.append(answer(status))
        before = present
    found = figures(*records)
    assert found["n"] == len(cycles)
    for status, name in enumerate(STATUSES):
        here = [present for each, present in cycles if each == status]
        assert found[name] == len(here)
        held = {NAMES[place]: sum(place in each for each in here) for place in range(3)}
        expected = {each: n for each, n in held.items() if n} if status >= UNCERTIFIED else {}
        assert found["reasons"].get(name, {}) == expected
    assert found["without"] == found["uncertified"] + found["infeasible"]


def test_a_controller_that_proves_nothing_has_no_count():
    assert figures(session(), answer(NONE), answer(NONE)) is None
    assert figures() is None


def test_a_status_that_nobody_defined_is_unknown():
    found = figures(answer(CERTIFIED), answer(77))
    assert (found["n"], found["unknown"], found["without"]) == (2, 1, 1)
    assert in_a_line(found) == (
        "1 of 2 answers certified; 1 unknown: invalid certificate: solver_status"
    )


def test_of_one_session_nothing_of_another_counts():
    records = [session(), condition(1, True), answer(INFEASIBLE)]
    others = [session(8), condition(0, True, 8), answer(UNCERTIFIED, number=8)]
    assert figures(*records, *others, of=7) == figures(*records)


def test_what_no_controller_has_recorded_is_left_out():
    junk = [Record(kind, 0, b"[" * 9) for kind in (Kind.SESSION, Kind.EVENT, Kind.SETPOINT)]
    junk += [Record(Kind.SESSION, 0, b"[1]"), Record(Kind.SESSION, 0, b'{"conditions": 3}')]
    found = figures(*junk, condition(-4, True), answer(INFEASIBLE))
    assert found["reasons"] == {"infeasible": {"condition -4": 1}}


@pytest.mark.parametrize(
    ("present", "words"),
    [
        (
            {0, 1},
            ": infeasible_constraints",
        ),  # that a limit slows it is no reason beside a real one
        ({0}, ": slowed"),
        (set(), ""),
        ({1, 2}, ": cannot_descend, infeasible_constraints"),
    ],
)
def test_people_read_one_line(present, words):
    records = [session(), *(condition(place, True) for place in sorted(present))]
    found = figures(*records, answer(CERTIFIED), answer(INFEASIBLE), answer(INFEASIBLE))
    assert in_a_line(found) == f"1 of 3 answers certified; 2 infeasible{words}"


def test_a_limit_is_a_reason_where_others_are_too_few():
    records = [session(), condition(0, True), answer(UNCERTIFIED), answer(UNCERTIFIED)]
    records += [condition(2, True), answer(UNCERTIFIED)]
    assert (
        in_a_line(figures(*records))
        == "0 of 3 answers certified; 3 uncertified: slowed, cannot_descend"
    )


def test_of_proofs_that_are_worth_little_there_is_a_word_even_where_all_is_proved():
    records = [session(), condition(0, True), condition(3, True), answer(CERTIFIED)]
    records += [answer(CERTIFIED), answer(AT_TARGET), condition(3, False), answer(CERTIFIED)]
    found = figures(*records)
    assert found["reasons"] == {"certified": {NAMES[3]: 2}, "at_target": {NAMES[3]: 1}}
    assert found["without"] == 0
    assert in_a_line(found) == f"4 of 4 answers certified, 3 with {NAMES[3]}"
    found = figures(*records, condition(2, True), answer(UNCERTIFIED))
    line = f"4 of 5 answers certified, 3 with {NAMES[3]}; 1 uncertified: slowed, cannot_descend"
    assert in_a_line(found) == line.replace("slowed, ", "")


def test_where_all_is_proved_there_is_nothing_to_say():
    assert in_a_line(figures(answer(CERTIFIED), answer(AT_TARGET))) is None
    assert in_a_line(None) is None


def test_a_recorder_counts_what_it_is_given():
    recorder = CountingRecorder()
    recorder.record(*session())
    recorder.record(*answer(UNCERTIFIED))
    assert recorder.count.figures()["uncertified"] == 1


def test_of_a_robots_log_each_tick_counts_once_also_after_a_stop():
    statistics = RunStatistics(MS, timing=False)
    state = State(1)
    state.session_id = 7
    for tick in range(4):
        state.tick, state.epoch = tick, 1 if tick < 3 else 0
        state.mode = State.ACTIVE if tick < 3 else State.STOPPED
        statistics.add(Record(Kind.STATE, 0, state.dump()))
        if tick:
            statistics.add(answer(INFEASIBLE, tick - 1))
        if tick == 1:
            statistics.add(answer(CERTIFIED, 0))  # a duplicate
    statistics.add(answer(CERTIFIED, 9))  # to nothing that it has asked
    statistics.add(answer(CERTIFIED, 3, number=8))
    found = statistics.figures()["certificates"]
    assert (found["n"], found["infeasible"]) == (3, 3)
    assert statistics.figures()["final_error"] == 0.0


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"solver_status": 0, "margin": -1.0}, set()),
        ({"solver_status": 1}, set()),
        ({"solver_status": 2, "margin": -1.0}, {"margin below zero"}),
        ({"solver_status": 2, "kkt_residual": 1e-8}, {"residual above 1e-9"}),
        ({"solver_status": 2, "v_rate_required": -1.0}, {"V falls too slowly"}),
        ({"solver_status": 3, "fallback": 2, "margin": -1.0}, {"fallback 2"}),
        ({"solver_status": 3}, {"the reason is in the controller's log"}),
        ({"solver_status": 4}, set()),
    ],
)
def test_a_setpoint_tells_why_it_has_no_certificate(fields, expected):
    setpoint = Setpoint(3)
    for name, value in fields.items():
        setattr(setpoint, name, value)
    assert reasons_on_wire(fields["solver_status"], setpoint.dump()) == expected
