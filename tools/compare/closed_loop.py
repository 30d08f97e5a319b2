"""Closed loop: each controller moves a robot of its own, in lockstep, from the same start."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.tools.compare.answers import MOST_TIMED, Answers, RecordedInputs, table
from hoap3.tools.compare.candidates import Candidate
from hoap3.tools.show.verdicts import judge_reported
from hoap3.tools.simulate import Lockstep

SAID_TICKS = 1000  # after so many the progress is told


class ClosedLoop:
    """One controller and its robot.

    Args:
        candidate: the controller.
        emulator, file: settings of the robot, its seed included, and where they were read.

    Raises:
        UsageError: the controller cannot be built for this robot.
    """

    def __init__(self, candidate: Candidate, emulator: EmulatorConfig, file: str) -> None:
        self._states, self._setpoints = RecordedInputs(Kind.STATE), RecordedInputs(Kind.SETPOINT)
        tapes = self._states, self._setpoints
        self._lockstep = Lockstep(emulator, candidate.config, *tapes, files=(file, candidate.words))

    def run(self, duration: float, say: Callable[[str], None] = lambda _: None) -> Answers:
        """Move for `duration` [s] of virtual time; `say` takes how far it is, in words.

        Raises:
            Hoap3Error: the controller failed.
        """
        lockstep = self._lockstep

        def report(done: int, whole: int) -> None:
            if done % SAID_TICKS == 0:
                say(f"{100 * done // whole} % of {duration:g} s in lockstep")

        lockstep.run(duration, report=report)
        states = table(self._states.payloads, State)
        setpoints = table(self._setpoints.payloads, Setpoint)
        _, asked, answers = np.intersect1d(
            states["tick"], setpoints["tick"], assume_unique=True, return_indices=True
        )
        return Answers(
            description=lockstep.controller.description,
            controller=lockstep.controller,
            states=states[asked],
            setpoints=setpoints[answers],
            asked=[self._states.payloads[place] for place in asked[:MOST_TIMED]],
            closed_loop=True,
            success_rate=lockstep.robot.validator.deadlines.run_rate,
            safe_stops=lockstep.robot.safe_stops,
            judged=_judged(lockstep),
        )


def _judged(lockstep: Lockstep) -> dict[str, Any]:
    robot = lockstep.robot
    counted: dict[str, Any] = robot.summary()
    return judge_reported(counted, lockstep.controller_loop.summary)
