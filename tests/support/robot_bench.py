"""A robot on virtual time whose setpoints are written by the test, tick by tick."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from hoap3.protocol.link.base import LockstepLink
from hoap3.protocol.messages import COMMANDS, Event, Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.realtime import Ticker
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.loop import RobotLoop
from support.small_arm import PERIOD_NS, arm

SESSION = 7
EVENT_NAMES = {
    value: name
    for name, value in Event.schema.constants.items()
    if not name.startswith(("REASON", "WIRE"))
}

DelayModel = Callable[[int, bytes], Iterable[tuple[int, bytes]]]


class Oversleeper(VirtualClock):
    """A clock whose sleeps end late when the test says so."""

    late = 0

    def sleep_until(self, deadline: int) -> None:
        super().sleep_until(deadline)
        self.advance(self.late)
        self.late = 0


class Bench:
    """The robot, stepped by hand. `fate(tick, answer)` gives (delay, payload) pairs.

    Setpoints move the joints at `speed`, where the robot takes positions; otherwise they are
    `values`.
    """

    def __init__(
        self,
        fate: DelayModel | None = None,
        grace: int = 0,
        lead: int = 0,
        description: RobotDescription | None = None,
        **config: object,
    ) -> None:
        self.clock = Oversleeper()
        self.fate: DelayModel = fate or (lambda tick, answer: [(1000, answer)])
        self.link = LockstepLink(self._answer, self.clock, fate=self._fates)
        self.recorder = MemoryRecorder()
        self.description = description or arm()
        self.n = self.description.n
        settings = EmulatorConfig(robot="arm", **config)
        self.robot = RobotLoop(
            self.description,
            settings,
            self.clock,
            self.link,
            self.recorder,
            SESSION,
            grace_ticks=grace,
            lead=lead,
        )
        self.ticker = Ticker(self.clock, PERIOD_NS, 0)
        self.kind = self.description.command_kinds[0]
        self.speed, self.values = np.zeros(self.n), np.zeros(self.n)
        self.changes: dict[str, object] = {}
        self._tick = 0

    def oversleep(self, late: dict[int, int]) -> None:
        """Let wake-ups come late: by tick [ns], each once."""
        waited = self.clock.sleep_until

        def sleep_until(deadline: int) -> None:
            waited(deadline)
            tick, rest = divmod(deadline, PERIOD_NS)
            if not rest:
                self.clock.advance(late.pop(tick, 0))

        self.clock.sleep_until = sleep_until

    def run(self, ticks: int) -> State:
        """Step that many ticks; the newest State."""
        for _ in range(ticks):
            self.ticker.wait()
            self.robot.step(self.ticker)
        return self.states()[-1]

    def states(self) -> list[State]:
        found = []
        for record in self.recorder.records:
            if record.kind == Kind.STATE:
                state = State.allocate(**self.description.state_lengths)
                state.load(record.payload)
                found.append(state)
        return found

    def events(self) -> list[tuple[str, int, int]]:
        found = []
        for record in self.recorder.records:
            if record.kind == Kind.EVENT:
                event = Event()
                event.load(record.payload)
                found.append((EVENT_NAMES[event.kind], event.tick, event.detail))
        return found

    def _answer(self, payload: bytes) -> bytes | None:
        state = State.allocate(**self.description.state_lengths)
        state.load(payload)
        self._tick = state.tick
        if state.mode != State.ACTIVE:
            return None
        return self.setpoint(state)

    def setpoint(self, state: State, **changes: object) -> bytes:
        """An answer to a State."""
        setpoint = Setpoint(self.n)
        setpoint.session_id, setpoint.tick, setpoint.epoch = SESSION, state.tick, state.epoch
        setpoint.stamp_state = state.stamp_published
        setpoint.command = COMMANDS[self.kind]
        ahead = state.reference + self.speed * 1e-3
        setpoint.values[:] = ahead if self.kind == "position" else self.values
        for name, value in {**self.changes, **changes}.items():
            setattr(setpoint, name, value)
        return setpoint.dump()

    def _fates(self, answer: bytes) -> Iterable[tuple[int, bytes]]:
        return self.fate(self._tick, answer)


def active(who: str = "test", **options: Any) -> Bench:
    """A robot that follows a client from tick 0."""
    bench = Bench(**options)
    bench.link.ask("acquire", who)
    return bench
