"""What a controller makes of the robot's word that another client sends setpoints, too."""

from __future__ import annotations

import pytest
from loop_bench import SESSION
from loop_bench import Bench as Controller

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Kind

CONFLICT = Event.schema.constants["CONFLICTING_SETPOINTS"]
SECOND = 1_000_000_000


def told(controller: Controller) -> list[int]:
    """Details of the events that a controller has recorded."""
    records = [each for each in controller.recorder.records if each.kind == Kind.EVENT]
    events = [Event.scalars(record.payload, "kind", "detail") for record in records]
    return [detail for kind, detail in events if kind == CONFLICT]


def conflict(count: int, **changes: int) -> bytes:
    event = Event()
    event.kind, event.session_id, event.detail = CONFLICT, SESSION, count
    for name, value in changes.items():
        setattr(event, name, value)
    return event.dump()


def test_a_controller_records_it_once_a_second_at_most():
    controller = Controller()
    for count in range(1, 5):
        controller.loop.receive_event(conflict(count))
    controller.clock.advance(SECOND)
    controller.loop.receive_event(conflict(9))
    assert told(controller) == [1, 9]


@pytest.mark.parametrize(
    "payload",
    [b"", b"garbage", conflict(1)[:-1], conflict(1, session_id=8), conflict(1, kind=1)],
)
def test_a_controller_takes_nothing_else_for_it(payload):
    controller = Controller()
    controller.loop.receive_event(payload)
    assert told(controller) == []
    controller.loop.receive_event(conflict(2))
    assert told(controller) == [2]
