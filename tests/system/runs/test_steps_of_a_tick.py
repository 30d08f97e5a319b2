"""How much Python one tick takes: what a newcomer has to follow, and what a cold cache has to load.

Counted in lockstep, robot and controller together, from the robot's wake-up to the recorded answer.
"""

from __future__ import annotations

import sys
from types import FrameType
from typing import Any

from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.tools.simulate import Lockstep, controller_settings, emulator_settings

WARM, COUNTED = 100, 100  # ticks
MOST_CALLS = 96


def test_one_state_of_qp12_takes_few_python_calls():
    lockstep = Lockstep(
        emulator_settings("hoap3", 0),
        controller_settings("qp12"),
        MemoryRecorder(),
        MemoryRecorder(),
    )
    calls = 0

    def count(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal calls
        calls += event == "call"

    def watch() -> bool:
        tick = lockstep.robot.tick
        if tick in (WARM, WARM + COUNTED):
            sys.setprofile(count if tick == WARM else before)
        return False

    before = sys.getprofile()
    try:
        lockstep.run((WARM + COUNTED + 10) * 1e-3, should_stop=watch)
    finally:
        sys.setprofile(before)
    assert COUNTED < calls <= MOST_CALLS * COUNTED
