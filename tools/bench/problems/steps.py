"""Whole cycles of a controller: its steps along States of its own motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hoap3.protocol.messages import State
from hoap3.protocol.runtime.recorder import MemoryRecorder, NoRecorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.config import build
from hoap3.tools.simulate import Lockstep, controller_settings, emulator_settings

STATES = 256
FIRST = 10  # State: those before belong to the start


def motion(
    emulator: str | Mapping[str, Any],
    controller: str | Mapping[str, Any],
    duration: float,
    *,
    every: bool = False,
) -> tuple[Any, list[State]]:
    """A controller after its reset, and States of a motion in lockstep, in their order.

    Args:
        emulator, controller: names of configs, or settings.
        duration: of the motion [s].
        every: whether all States are wanted, not only some `STATES` of them.
    """
    log, config = MemoryRecorder(), controller_settings(controller)
    lockstep = Lockstep(emulator_settings(emulator, 0), config, log, NoRecorder())
    lockstep.run(duration)
    description = lockstep.controller.description
    payloads = [record.payload for record in log.records if record.kind == Kind.STATE]
    states = []
    stride = 1 if every else max(1, len(payloads) // STATES)
    for payload in payloads[FIRST::stride]:
        state = State.allocate(**description.state_lengths)
        state.load(payload)
        states.append(state)
    law = build(config, description)
    law.reset(states[0], None)
    return law, states
