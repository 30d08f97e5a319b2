"""Recounts deadlines and messages from a robot's log alone, as docs/start/concepts.md defines.

The log has what the robot saw in the order in which it saw it: each Setpoint with its arrival
stamp stands before the first State whose counts it is part of.
"""

from __future__ import annotations

from array import array
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from hoap3.protocol.errors import WireError
from hoap3.protocol.messages import COMMANDS, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription

WINDOW = 100  # ticks of the success rate
REMEMBERED = 1024  # ticks for which an answer is still known to have been asked for
MOST = {"extra": 256, "decision": 512, "slacks": 256, "gains": 256, "next": 1024}
"""Numbers of each array of a Setpoint that a robot takes, as docs/reference/wire.md has it."""
COUNTED = ("late", "lost", "duplicate", "out_of_order", "rejected", "success_rate")


@dataclass
class _Asked:
    epoch: int
    due: int
    arrived: int | None = None
    missed: bool = False


@dataclass
class Recount:
    """What a robot should have counted.

    Args:
        description: of the robot.

    Attributes:
        last_tick: of the newest State, -1 before the first.
        ticks, stated, found: of each State its tick, and counts as in `COUNTED`, (N · 6,).
        runs: each tick in which the robot follows somebody, and misses in a row there, (M · 2,).
        asked, in_time, longest_run: over all deadlines that have passed; run: misses at their end.
    """

    description: RobotDescription
    ticks: array[int] = field(default_factory=lambda: array("q"))
    stated: array[float] = field(default_factory=lambda: array("d"))
    found: array[float] = field(default_factory=lambda: array("d"))
    runs: array[int] = field(default_factory=lambda: array("q"))
    asked: int = 0
    in_time: int = 0
    longest_run: int = 0

    def __post_init__(self) -> None:
        description = self.description
        self._setpoint = Setpoint(description.n)
        self._period = round(description.period_s * 1e9)
        self._allowed = (1 + description.delay_ticks) * self._period
        self._from_publication = description.deadline == "after_receipt"
        self._command = COMMANDS[description.command_kinds[0]]
        self._ticks: dict[int, _Asked] = {}
        self._waiting: deque[int] = deque()
        self._last = deque[bool](maxlen=WINDOW)
        self._late = self._lost = self._twice = self._disordered = self._refused = 0
        self.run, self._newest, self.last_tick = 0, -1, -1
        self._session, self._active = -1, False

    def setpoint(self, stamp: int, payload: bytes) -> None:
        """Take a message that arrived at `stamp` [ns]."""
        setpoint = self._fitting(payload)
        asked = None if setpoint is None else self._answered(setpoint)
        if setpoint is None or asked is None:
            self._refused += 1
        elif asked.arrived is not None:
            self._twice += 1
        else:
            asked.arrived = stamp
            if asked.missed:
                self._lost -= 1
                self._late += 1
            self._disordered += setpoint.tick <= self._newest
            self._newest = max(self._newest, setpoint.tick)

    def state(self, payload: bytes) -> None:
        """Take a State: deadlines that have passed by its intended start are counted now."""
        names = ("mode", "session_id", "tick", "epoch", "stamp_intended", "stamp_published")
        mode, self._session, tick, epoch, intended, published = State.scalars(payload, *names)
        while self._waiting and self._ticks[self._waiting[0]].due <= intended:
            self._count(self._ticks[self._waiting.popleft()])
        if mode == State.ACTIVE and not self._active:
            self._newest, self.run = max(self._newest, tick - 1), 0
        self._active = mode == State.ACTIVE
        counts = self._late, self._lost, self._twice, self._disordered, self._refused
        rate = sum(self._last) / len(self._last) if self._last else 1.0
        self.ticks.append(tick)
        self.stated.extend(State.scalars(payload, *COUNTED))
        self.found.extend((*counts, rate))
        if self._active:
            self.runs.extend((tick, self.run))
            due = (published if self._from_publication else intended) + self._allowed
            self._ticks[tick] = _Asked(epoch, due)
            self._waiting.append(tick)
            self._ticks.pop(tick - REMEMBERED, None)
        self.last_tick = tick

    def _fitting(self, payload: bytes) -> Setpoint | None:
        """The Setpoint, if it can be one for this robot."""
        try:
            self._setpoint.load(payload)
        except WireError:  # its arrays may have other lengths
            try:
                other = Setpoint.like(payload)
                other.load(payload)
            except WireError:
                return None
            found = other.lengths
            if found.pop("values") != self.description.n:
                return None
            if any(length > MOST[name] for name, length in found.items()):
                return None
            self._setpoint = other
        return self._setpoint

    def _answered(self, setpoint: Setpoint) -> _Asked | None:
        """What it answers, if that was asked for, and so that the robot may follow it."""
        asked = self._ticks.get(setpoint.tick)
        fits = (
            asked is not None
            and setpoint.session_id == self._session
            and self.last_tick - REMEMBERED < setpoint.tick <= self.last_tick
            and asked.epoch == setpoint.epoch
            and setpoint.command == self._command
            and bool(np.isfinite(setpoint.values).all())
        )
        return asked if fits else None

    def _count(self, asked: _Asked) -> None:
        hit = asked.arrived is not None and asked.arrived <= asked.due
        self.asked += 1
        self.in_time += hit
        self._last.append(hit)
        self.run = 0 if hit else self.run + 1
        self.longest_run = max(self.longest_run, self.run)
        if not hit:
            asked.missed = asked.arrived is None
            self._lost += asked.missed
            self._late += not asked.missed
