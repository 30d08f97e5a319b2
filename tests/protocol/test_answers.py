"""Answers from the network: what is accepted, and that all else is one named error."""

from __future__ import annotations

import json
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.fake_robot import GOOD, JUNK, STATUS, good, nonsense
from support.small_arm import arm

from hoap3.protocol.answers import (
    MAX_ANSWER_BYTES,
    MAX_CONTROL_BYTES,
    ControlAnswer,
    GrantAnswer,
    Recovery,
    Status,
    check_answer,
    parse_answer,
    parse_description,
)
from hoap3.protocol.errors import WireError

MODELS = {
    "status": Status,
    "recover": Recovery,
    "acquire": GrantAnswer,
    "show": ControlAnswer,
    "change": ControlAnswer,
}
DESCRIPTION = arm().to_json()


@pytest.mark.parametrize("verb", MODELS)
def test_a_good_answer_is_taken_as_it_is(verb):
    answer = parse_answer(MODELS[verb], good(verb, b""), "robot")
    assert answer.model_dump(exclude_unset=True) == GOOD[verb]


def test_a_key_that_is_not_known_is_left_out():
    answer = parse_answer(Status, json.dumps({**STATUS, "battery": 0.5}).encode(), "robot")
    assert answer.model_dump(exclude_unset=True) == STATUS


def test_older_robots_do_not_tell_why_they_are_stopped():
    assert parse_answer(Status, json.dumps(STATUS).encode(), "robot").stop_reason is None
    told = json.dumps({**STATUS, "mode": "stopped", "stop_reason": "holder_lost"}).encode()
    assert parse_answer(Status, told, "robot").stop_reason == "holder_lost"


def test_a_holder_may_have_any_name():
    content = {**STATUS, "holder": "\x1b[2J\n\u202e"}
    assert parse_answer(Status, json.dumps(content).encode(), "robot").holder == content["holder"]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("mode", "dancing"),
        ("mode", 1),
        ("holder", "x" * 65),
        ("holder", 7),
        ("session_id", 2**64),
        ("session_id", -1),
        ("session_id", 7.0),
        ("session_id", "7"),
        ("tick", True),
        ("lockstep", 0),
        ("lockstep", None),
        ("stop_reason", 3),
        ("stop_reason", "x" * 33),
        ("stop_reason", "misses\n"),
    ],
)
def test_a_wrong_value_is_named(key, value):
    raw = json.dumps({**STATUS, key: value}).encode()
    with pytest.raises(WireError, match=rf"'arm'.*'status'.*'{key}'"):
        parse_answer(Status, raw, "robot 'arm' answers 'status'")


def test_a_missing_right_is_reported_as_such():
    why = "'x.qp12-1' has no right to 'description': access.yaml does not list 'x'"
    with pytest.raises(WireError, match=why):
        parse_description(json.dumps({"error": why}).encode(), "arm")


@pytest.mark.parametrize("key", STATUS)
def test_a_missing_key_is_named(key):
    content = {other: value for other, value in STATUS.items() if other != key}
    with pytest.raises(WireError, match=rf"'{key}'"):
        parse_answer(Status, json.dumps(content).encode(), "robot")


GRANT = {**STATUS, "granted": True, "epoch": 1, "from_tick": 3}


def test_a_grant_of_an_older_robot_has_the_usual_rule():
    old = check_answer(GrantAnswer, GRANT, "robot")
    assert (old.deadline, old.delay_ticks) == ("next_tick", 0)
    new = check_answer(
        GrantAnswer, {**GRANT, "deadline": "after_receipt", "delay_ticks": 3}, "robot"
    )
    assert (new.deadline, new.delay_ticks) == ("after_receipt", 3)


@pytest.mark.parametrize(
    ("model", "content"),
    [
        (GrantAnswer, {**STATUS, "granted": True, "from_tick": 3}),
        (GrantAnswer, {**STATUS, "granted": True, "epoch": 0, "from_tick": 3}),
        (GrantAnswer, {**GRANT, "deadline": "whenever"}),
        (GrantAnswer, {**GRANT, "delay_ticks": 101}),
        (ControlAnswer, {"error": None, "now": None}),
        (ControlAnswer, {"error": "why", "now": {}}),
    ],
)
def test_what_does_not_fit_together_is_refused(model, content):
    with pytest.raises(WireError):
        check_answer(model, content, "robot")


def test_what_the_robot_says_is_wrong_is_told():
    with pytest.raises(WireError, match="unknown request"):
        parse_answer(Status, b'{"error": "unknown request"}', "robot")


def test_sizes_are_limited():
    padded = good("status", b"") + b" " * MAX_ANSWER_BYTES
    with pytest.raises(WireError, match="4096"):
        parse_answer(Status, padded, "robot")
    parse_answer(Status, padded, "robot", len(padded))


def test_a_description_bears_the_name_of_the_robot():
    name = arm().name
    assert parse_description(DESCRIPTION, name).digest == arm().digest
    with pytest.raises(WireError, match="'other'"):
        parse_description(DESCRIPTION, "other")


@pytest.mark.parametrize("junk", JUNK)
@pytest.mark.parametrize("verb", [*MODELS, "description"])
def test_junk_is_one_short_error_at_once(verb, junk):
    began = time.process_time()
    with pytest.raises(WireError) as caught:
        read(verb, junk)
    assert len(str(caught.value)) < 1000
    assert time.process_time() - began < 1.0


@given(st.randoms(use_true_random=False))
def test_no_mutation_of_an_answer_ends_in_anything_but_a_wire_error(draw):
    verb = draw.choice([*MODELS, "description"])
    try:
        read(verb, nonsense(verb, DESCRIPTION, draw))
    except WireError as error:
        problem = str(error)
    else:
        problem = ""
    assert len(problem) < 1000


def read(verb: str, raw: bytes) -> object:
    if verb == "description":
        return parse_description(raw, arm().name)
    return parse_answer(MODELS[verb], raw, "robot", MAX_CONTROL_BYTES)
