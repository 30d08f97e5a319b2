"""A controller's loop on virtual time whose States are written by the test, tick by tick."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from support.small_arm import arm

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import UsageError
from hoap3.protocol.messages import Event, Setpoint, State
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.controllers.base import Controller
from hoap3.remote_controller.loop import ControllerLoop

SESSION = 7
RESET = Event.schema.constants["RESET"]


class Wanderer(Controller):
    """Moves on by a thousandth at each step, takes its time, and remembers what it was told."""

    def __init__(self, clock: VirtualClock) -> None:
        super().__init__(arm(), Settings())
        self.clock = clock
        self.resets: list[tuple[int, list[float] | None]] = []
        self.steps: list[int] = []
        self.told: list[Mapping[str, Any]] = []
        self.pace: object = 1

    def reset(self, state: State, last_command: np.ndarray | None) -> None:
        kept = None if last_command is None else last_command.tolist()
        self.resets.append((state.tick, kept))

    def change(self, request: Mapping[str, Any]) -> None:
        if not request["pace"]:
            raise UsageError("no pace")
        self.told.append(request)

    def changeable(self) -> dict[str, Any]:
        return {"pace": self.pace}

    def step(self, state: State) -> Setpoint:
        self.steps.append(state.tick)
        self.clock.advance(100)
        self.command.stamp_kinematics = self.now()
        self.clock.advance(20)
        np.add(state.reference, 1e-3, out=self.command.values)
        return self.command


class Bench:
    """A loop whose States the test writes."""

    def __init__(self, epoch: int = 1) -> None:
        self.clock = VirtualClock(1_000)
        self.recorder = MemoryRecorder()
        self.controller = Wanderer(self.clock)
        self.loop = ControllerLoop(self.controller, self.clock, self.recorder, SESSION)
        if epoch:
            self.loop.grant(epoch)

    def state(self, tick: int, **changes: object) -> bytes:
        state = State(3)
        state.session_id, state.mode, state.epoch, state.tick = SESSION, State.ACTIVE, 1, tick
        state.stamp_published = 1_000_000 * tick + 50
        state.q[:] = state.reference[:] = 0.1 * tick
        for name, value in changes.items():
            setattr(state, name, value)
        return state.dump()

    def answer(self, payload: bytes) -> bytes | None:
        answer = self.loop.answer(self.clock.now(), payload)
        self.clock.advance(7)
        self.loop.sent()
        return answer

    def setpoint(self, payload: bytes) -> Setpoint:
        answer = self.answer(payload)
        assert answer is not None
        setpoint = Setpoint(3)
        setpoint.load(answer)
        return setpoint

    def recorded(self, kind: Kind) -> list[bytes]:
        return [record.payload for record in self.recorder.records if record.kind == kind]

    def resets_told(self) -> list[int]:
        """Ticks of all events, which are resets."""
        ticks = []
        for payload in self.recorded(Kind.EVENT):
            event = Event()
            event.load(payload)
            assert event.kind == RESET
            ticks.append(event.detail)
        return ticks
