"""The engagements in a controller's log, where records are missing."""

from __future__ import annotations

import json

from support.log_samples import describe, ticks

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.verify.controller_log import runs

EVENTS = Event.schema.constants


def event(kind: str) -> Record:
    """An event of a controller."""
    made = Event()
    made.kind = EVENTS[kind]
    return Record(Kind.EVENT, 0, made.dump())


def test_an_event_whose_state_is_missing_is_not_given_to_the_state_before():
    robot = describe(2)
    session = json.dumps({"side": "controller", "session_id": 7}).encode()
    begin = [Record(Kind.DESCRIPTION, 0, robot.to_json()), Record(Kind.SESSION, 0, session)]
    state, other = [each for each in ticks(2, 2) if each.kind == Kind.STATE]
    events = [event("RESET"), event("CONDITION_BEGAN")]
    gap = Record(Kind.GAP, 0, b'{"dropped": 1}')
    (whole,) = runs([*begin, state, *events, other])
    assert (whole.resets, [place for place, *_ in whole.conditions]) == ([0], [0])
    (parted,) = runs([*begin, state, gap, *events, other])
    assert (parted.resets, [place for place, *_ in parted.conditions]) == ([], [1])
