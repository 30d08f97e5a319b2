"""Logs of a run that is made up: every stage of every tick has a given length.

The controller is a queue of one: the newest State waits, older ones are overwritten. Its clock
has nothing to do with the robot's.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind, Record
from support.log_samples import describe, write

MS, US = 1_000_000, 1_000
START = 7_000_000_000
SESSION, EPOCH = 7, 3
USUAL_US = {
    "wakeup": 40, "publish": 30, "inbound": 35, "decode": 6, "kinematics": 8, "solve": 20,
    "encode": 5, "send": 9, "outbound": 40,
}  # fmt: skip
"""Usual length of each stage; `inbound` and `outbound` together are the network."""

EVENTS = Event.schema.constants


@dataclass
class Story:
    """A run of `count` active ticks, one after the other.

    Attributes:
        lengths: of each stage, by tick [us], with a little noise of its own.
        skipped: ticks that the robot slept through.
        vanished: ticks whose answer is lost on its way.
        undelivered: ticks whose State is lost on its way.
        stalls: pairs of (start after `START`, length) [ns]; None where nobody watches.
        kept_silent: ticks that the controller does not answer.
        offset: of the controller's clock against the robot's [ns].
    """

    count: int
    seed: int = 0
    lengths: dict[str, np.ndarray] = field(default_factory=dict)
    skipped: set[int] = field(default_factory=set)
    vanished: set[int] = field(default_factory=set)
    undelivered: set[int] = field(default_factory=set)
    kept_silent: set[int] = field(default_factory=set)
    stalls: list[tuple[int, int]] | None = None
    offset: int = -3_000_000_000
    refuse: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        for name, usual in USUAL_US.items():
            noise = rng.uniform(0, 2, self.count)
            self.lengths.setdefault(name, usual + noise)

    def slow(self, stage: str, ticks: object, length_us: float) -> Story:
        """Make a stage of some ticks as long as that."""
        self.lengths[stage][ticks] = length_us
        return self

    def of(self, stage: str, tick: int) -> int:
        """Its length in a tick, or in the one after the last, where the robot rests [ns]."""
        return round(self.lengths[stage][min(tick, self.count - 1)] * US)

    def records(self) -> tuple[list[Record], list[Record]]:
        """Logs of the robot and of the controller."""
        robot, flying = self._robot()
        controller, answers = self._controller(flying)
        robot += answers
        robot.sort(key=lambda record: record.stamp)
        return _head("robot") + robot, _head("controller", self.offset) + controller

    def write(self, folder: Path, *, controller: bool = True) -> Path:
        """Write both logs, or the robot's alone."""
        robot, theirs = self.records()
        about = {"attachments": {"description.json": describe(1).to_json()}}
        write(folder / "robot.mcap", robot, **about)
        if controller:
            write(folder / "controller.mcap", theirs, side="controller", **about)
        return folder

    def _robot(self) -> tuple[list[Record], list[tuple[int, int, bytes]]]:
        """Records of the robot, and its States on their way: arrival, tick, bytes."""
        state, records, flying, skipped = State(1), [], [], 0
        last_arrival = START + self.offset
        state.session_id, state.epoch = SESSION, EPOCH
        for tick in range(self.count + 1):
            if tick in self.skipped:
                skipped += 1
                continue
            state.tick, state.skipped = tick, skipped
            state.lost = sum(lost < tick for lost in self.vanished)  # late ones: nobody counts them
            state.mode = State.ACTIVE if tick < self.count else State.STOPPED
            state.stamp_intended = START + tick * MS
            state.stamp_actual = state.stamp_intended + self.of("wakeup", tick)
            state.stamp_published = state.stamp_actual + self.of("publish", tick)
            payload = state.dump()
            records.append(Record(Kind.STATE, state.stamp_published, payload))
            if tick not in self.undelivered:
                arrival = state.stamp_published + self.of("inbound", tick) + self.offset
                last_arrival = max(last_arrival, arrival)  # a stream keeps the order
                flying.append((last_arrival, tick, payload))
        if self.stalls is not None:
            records.append(_event("STALLS_WATCHED", START - MS, 0, 1))
            for start, length in self.stalls:
                records.append(_event("HOST_STALL", START + start, 0, length))
        return records, flying

    def _controller(
        self, flying: list[tuple[int, int, bytes]]
    ) -> tuple[list[Record], list[Record]]:
        """Records of the controller, and its answers as they arrive at the robot."""
        records, arrived, free, last_tick, last_sent = [], [], START + self.offset, -1, 0
        setpoint = Setpoint(1)
        setpoint.session_id = SESSION
        for place, (arrival, tick, payload) in enumerate(flying):
            received = max(free, arrival)
            if place + 1 < len(flying) and flying[place + 1][0] <= received:
                continue  # overwritten by the next
            if last_tick >= 0 and tick - last_tick > 1:
                missed = tick - last_tick - 1
                records.append(_event("OVERWRITTEN", received, last_tick, missed))
            records.append(Record(Kind.STATE, received, payload))
            at = received
            for stage, stamp in STAMPS.items():
                at += self.of(stage, tick)
                setattr(setpoint, stamp, at)
            setpoint.tick, setpoint.stamp_received = tick, received
            setpoint.epoch = EPOCH + (tick in self.refuse)
            setpoint.stamp_state = State.scalars(payload, "stamp_published")[0]
            setpoint.stamp_sent_previous = last_sent
            if tick not in self.kept_silent and tick < self.count:
                answer = setpoint.dump()
                records.append(Record(Kind.SETPOINT, at, answer))
                back = at + self.of("send", tick) + self.of("outbound", tick) - self.offset
                if tick not in self.vanished:
                    arrived.append(Record(Kind.SETPOINT, back, answer))
                at += self.of("send", tick)
            free = last_sent = at
            last_tick = tick
        return records, arrived


STAMPS = {
    "decode": "stamp_decoded",
    "kinematics": "stamp_kinematics",
    "solve": "stamp_solved",
    "encode": "stamp_encoded",
}


def _head(side: str, offset: int = 0) -> list[Record]:
    session = {"side": side, "session_id": SESSION, "lockstep": False}
    stamp = START - MS + offset
    return [
        Record(Kind.DESCRIPTION, stamp, describe(1).to_json()),
        Record(Kind.SESSION, stamp, json.dumps(session).encode()),
    ]


def _event(kind: str, stamp: int, tick: int, detail: int) -> Record:
    event = Event()
    event.kind, event.session_id, event.tick = EVENTS[kind], SESSION, tick
    event.stamp, event.detail = stamp, detail
    return Record(Kind.EVENT, stamp, event.dump())
