"""What a controller makes of the robot's word that it has stopped, and waits for `recover`."""

from __future__ import annotations

import pytest
from loop_bench import SESSION, Wanderer

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.loop import ControllerLoop

CONSTANTS = Event.schema.constants
STOP = CONSTANTS["SAFE_STOP"]
MISSES, COMMAND = CONSTANTS["REASON_MISSES"], CONSTANTS["REASON_COMMAND"]
SECOND = 1_000_000_000


class Wall:
    """Time of a wall that the test moves on."""

    def __init__(self) -> None:
        self.time = 5 * SECOND

    def now(self) -> int:
        return self.time

    def sleep_until(self, deadline: int) -> None:
        self.time = max(self.time, deadline)


class Bench:
    """A loop that only hears."""

    def __init__(self, clock: Wall | VirtualClock) -> None:
        self.recorder = MemoryRecorder()
        self.loop = ControllerLoop(Wanderer(VirtualClock()), clock, self.recorder, SESSION)

    def told(self) -> list[int]:
        records = [each for each in self.recorder.records if each.kind == Kind.EVENT]
        events = [Event.scalars(record.payload, "kind", "detail") for record in records]
        return [detail for kind, detail in events if kind == STOP]


def stop(reason: int, session_id: int = SESSION) -> bytes:
    event = Event()
    event.kind, event.session_id, event.detail = STOP, session_id, reason
    return event.dump()


def test_a_stop_that_lasts_is_recorded_once_a_second_at_most():
    clock = Wall()
    bench = Bench(clock)
    for reason in (MISSES, COMMAND, MISSES):
        bench.loop.receive_event(stop(reason))
    assert bench.told() == [MISSES]
    clock.time += SECOND
    bench.loop.receive_event(stop(COMMAND))
    assert bench.told() == [MISSES, COMMAND]


@pytest.mark.parametrize("reason", ["RELEASED", "SHUTDOWN", "ENDED"])
def test_a_robot_that_nobody_needs_to_recover_is_not_recorded(reason):
    bench = Bench(Wall())
    bench.loop.receive_event(stop(CONSTANTS[f"REASON_{reason}"]))
    assert bench.told() == []


def test_another_session_and_an_unknown_reason_are_not_recorded():
    bench = Bench(Wall())
    bench.loop.receive_event(stop(MISSES, SESSION + 1))
    bench.loop.receive_event(stop(200))
    assert bench.told() == []


def test_in_virtual_time_the_log_stays_the_same_whenever_the_word_comes():
    bench = Bench(VirtualClock())
    bench.loop.receive_event(stop(MISSES))
    assert bench.told() == []


def test_events_without_effect_are_counted_by_reason():
    bench = Bench(Wall())
    for payload in (b"", stop(MISSES)[:-1], stop(MISSES, SESSION + 1), stop(MISSES)):
        bench.loop.receive_event(payload)
    assert (bench.loop.rejected_events, bench.loop.foreign_events) == (2, 1)
    assert bench.told() == [MISSES]
