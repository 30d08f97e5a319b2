"""Two different answers to one tick: another client sends setpoints in the holder's name."""

from __future__ import annotations

import numpy as np
import pytest
from support.robot_bench import Bench

from hoap3.protocol.messages import Setpoint
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.tools.services.run_statistics import RunStatistics

STAMP_LIE = 10_000_000_000  # ns


def changed(answer: bytes, **fields: object) -> bytes:
    """The same answer with other values in some fields."""
    setpoint = Setpoint(3)
    setpoint.load(answer)
    for name, value in fields.items():
        if name == "values":
            setpoint.values[:] = value
        else:
            setattr(setpoint, name, value)
    return setpoint.dump()


def attacked(*forged: dict, since: int = 0, first: bool = False) -> Bench:
    """A robot that is sent these answers besides the true one, before or behind it."""

    def fate(tick: int, answer: bytes):
        lies = [changed(answer, **fields) for fields in forged] if tick >= since else []
        order = [*lies, answer] if first else [answer, *lies]
        return [(1000 + place, each) for place, each in enumerate(order)]

    bench = Bench(fate)
    bench.link.ask("acquire", "alice")
    return bench


def told(bench: Bench) -> list[tuple[int, int]]:
    """Ticks and details of the events."""
    return [
        (tick, detail) for name, tick, detail in bench.events() if name == "CONFLICTING_SETPOINTS"
    ]


@pytest.mark.parametrize("first", [True, False])
def test_a_second_and_different_answer_is_told_at_once(first):
    bench = attacked({"values": 0.1}, since=5, first=first)
    state = bench.run(7)
    assert told(bench) == [(6, 1)]
    assert state.duplicate == 1
    assert bench.robot.summary()["conflicting"] == 1


def test_it_is_told_once_a_second_and_counted_always():
    bench = attacked({"values": 0.1}, {"values": 0.2}, since=100)
    bench.run(2500)
    ticks = [tick for tick, _ in told(bench)]
    assert ticks == [101, 1101, 2101]
    assert [detail for _, detail in told(bench)] == [2, 2002, 4002]
    assert bench.robot.summary()["conflicting"] == 2 * (2500 - 101)


def test_what_came_within_the_second_is_told_after_it():
    bench = attacked({"values": 0.1})
    bench.run(10)
    bench.fate = lambda tick, answer: [(1000, answer)]
    bench.run(1500)
    assert [detail for _, detail in told(bench)] == [1, bench.robot.validator.conflicting]


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"stamp_state": 0},
        {"epoch": 9, "values": 0.1},
        {"session_id": 1, "values": 0.1},
        {"command": 2, "values": 0.1},
        {"values": np.nan},
    ],
    ids=["same bytes", "same values", "epoch", "session", "command", "not finite"],
)
def test_what_names_no_other_motion_or_is_refused_is_no_conflict(fields):
    bench = attacked(fields)
    bench.run(50)
    assert told(bench) == []
    assert bench.robot.validator.conflicting == 0


def test_a_conflict_is_noticed_where_both_come_too_late_to_be_followed():
    def fate(tick: int, answer: bytes):
        if tick != 5:
            return [(1000, answer)]
        return [(5_000_000, answer), (5_000_001, changed(answer, values=0.1))]

    bench = Bench(fate)
    bench.link.ask("acquire", "alice")
    bench.run(20)
    assert len(told(bench)) == 1


def statistics(bench: Bench) -> RunStatistics:
    """Figures of what the robot recorded."""
    found = RunStatistics(1_000_000)
    found.add(Record(Kind.DESCRIPTION, 0, bench.description.to_json()))
    for record in bench.recorder.records:
        found.add(record)
    return found


LIES = {
    "other motion": {"values": 0.1},
    "not finite": {"values": np.nan},
    "other kind": {"command": 2},
    "other epoch": {"epoch": 9},
    "same motion": {},
}


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("lie", LIES)
def test_an_intruders_stamps_enter_no_figure(lie, first):
    """Wherever it comes first and is followed, its stamps are those of no State."""
    stamps = {"stamp_state": -STAMP_LIE, "stamp_received": -STAMP_LIE, "v": 1e9}
    bench = attacked({**LIES[lie], **stamps}, first=first)
    bench.run(200)
    found = statistics(bench)
    times = [found.rtt, *found.stages.values()]
    assert all(each.summary().get("max", 0.0) < 1000.0 for each in times)
    followed = first and lie in {"other motion", "same motion"}
    assert (found.rtt.summary()["n"] == 0) == followed
    assert (found.live()["error"] > 1.0) == followed


def test_each_followed_answer_is_in_the_figures_once():
    bench = attacked({"values": 0.1}, {})
    bench.run(200)
    found = statistics(bench).figures()
    assert found["rtt_us"]["n"] == bench.robot.validator.deadlines.asked
    assert found["rtt_us"]["max"] == pytest.approx(1.0, rel=1e-2)
