"""Both ways to have controllers answer: each moves a robot of its own, or all answer one log.

In closed loop each controller moves its robot in lockstep, from the same start. In open loop every
controller answers the States of one log, and nothing is applied.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hoap3.protocol.errors import LogError
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.recorder import MemoryRecorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.config import build
from hoap3.remote_controller.controllers.base import Controller
from hoap3.remote_controller.loop import failure
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.tools.analysis.answer_series import pair_answers
from hoap3.tools.analysis.compare.candidates import Candidate
from hoap3.tools.analysis.numbers import summary
from hoap3.tools.analysis.report.sources import Sources, of_ours
from hoap3.tools.analysis.verdicts import judge, judge_reported
from hoap3.tools.bench.case_runner import BLOCKS, SETTLE, Case, Times, time_cases
from hoap3.tools.logs.log import Log
from hoap3.tools.machine.machine import machine_block
from hoap3.tools.services.simulate import Lockstep, table_of

MOST_TIMED = 4_000  # answers of which the States are kept as bytes, to be timed on
LEAST_TIMED = 10  # answers in a block
PROGRESS_TICKS = 1000  # between two reports of progress
Rows = np.ndarray[Any, Any]
Say = Callable[[str], None]


@dataclass(frozen=True)
class Answers:
    """What one controller answered.

    Attributes:
        description: of the robot.
        controller: the answers' author, in its final state.
        states, setpoints: (k,) structured arrays, States and the answer to each.
        asked: the first of these States as bytes, at most MOST_TIMED.
        closed_loop: whether its answers moved the robot.
        success_rate: share of answers in time; None in open loop.
        safe_stops: of the robot.
        judged: the three verdicts, and what they rest on, as `analysis.verdicts.judge` has
            them; in open loop none is judged.
    """

    description: RobotDescription
    controller: Controller
    states: Rows
    setpoints: Rows
    asked: list[bytes]
    closed_loop: bool
    success_rate: float | None = None
    safe_stops: int = 0
    judged: dict[str, Any] = field(default_factory=lambda: judge(None, {}, None))


def closed_loop(
    candidate: Candidate, emulator: EmulatorConfig, file: str, duration: float, say: Say
) -> Callable[[], Answers]:
    """Build one controller with its robot; the call that is returned moves it.

    Args:
        candidate: the controller.
        emulator, file: settings of the robot, its seed included, and where they were read.
        duration: of the motion [s] of virtual time.
        say: takes how far it is, in words.

    Raises:
        UsageError: the controller cannot be built for this robot.
        Hoap3Error: the controller failed; only from the call.
    """
    sent, own = MemoryRecorder(), MemoryRecorder()
    lockstep = Lockstep(emulator, candidate.config, sent, own, files=(file, candidate.words))

    def report(done: int, whole: int) -> None:
        if done % PROGRESS_TICKS == 0:
            say(f"{candidate.label}: {100 * done // whole} % of {duration:g} s in lockstep")

    def run() -> Answers:
        lockstep.run(duration, report=report)
        payloads = sent.payloads(Kind.STATE)
        states = table_of(payloads, State)
        setpoints = table_of(own.payloads(Kind.SETPOINT), Setpoint)
        asked, answers = pair_answers(states, setpoints)
        return Answers(
            description=lockstep.controller.description,
            controller=lockstep.controller,
            states=states[asked],
            setpoints=setpoints[answers],
            asked=[payloads[place] for place in asked[:MOST_TIMED]],
            closed_loop=True,
            success_rate=lockstep.robot.validator.deadlines.run_rate,
            safe_stops=lockstep.robot.safe_stops,
            judged=judge_reported(lockstep.robot.summary(), lockstep.controller_loop.summary),
        )

    return run


def read_asked(path: Path) -> tuple[RobotDescription, list[bytes]]:
    """Read the States of a log that asked for an answer: of the session with most of them.

    Args:
        path: folder of a run, or one `*.mcap`; of a run, the robot's log if there is one.

    Raises:
        LogError: no log of ours, or none in which a robot was active.
    """
    with of_ours(path):
        for log in Sources.open(path).logs:
            found = _asked(log)
            if found:
                return log.description, found
    raise LogError(
        f"{path}: no State in it asks for an answer: the robot was never active. Name the log of "
        "a run with motion"
    )


def open_loop(
    candidate: Candidate, description: RobotDescription, payloads: list[bytes]
) -> Callable[[], Answers]:
    """Build one controller; the call that is returned answers all States, reset at the first.

    Args:
        candidate: the controller.
        description, payloads: as `read_asked` gives them.

    Raises:
        UsageError: the controller cannot be built for the robot of the log.
        Hoap3Error: the controller failed; names the tick; only from the call.
    """
    controller: Controller = build(candidate.config, description, candidate.words)

    def run() -> Answers:
        clock, answers = VirtualClock(), list[bytes]()
        controller.now = clock.now
        state = State.allocate(**description.state_lengths)
        for payload in payloads:
            state.load(payload)
            clock.sleep_until(state.stamp_published)
            try:
                if not answers:
                    controller.reset(state, None)
                command = controller.step(state)
            except (Exception, SystemExit) as error:  # nobody else may end us
                raise failure(controller, f"failed at tick {state.tick}", error) from error
            command.tick = state.tick
            answers.append(command.dump())
        return Answers(
            description=description,
            controller=controller,
            states=table_of(payloads, State),
            setpoints=table_of(answers, Setpoint),
            asked=payloads[:MOST_TIMED],
            closed_loop=False,
        )

    return run


def time_answers(labels: Sequence[str], answers: Sequence[Answers]) -> dict[str, Any]:
    """Time all controllers in turn, on the States that they answered, from a reset at the first.

    Stamps of a lockstep run are virtual, so this answers the States once more with a real clock.

    Returns:
        `rows`, with `step_us` as n, min, percentiles and max, and `times_first`, the median over
        the blocks of the ratio of medians; `blocks`; and `machine`.
    """
    count = min(len(each.asked) for each in answers)
    blocks = max(1, min(BLOCKS, count // LEAST_TIMED))
    times: dict[str, Times] = {}
    if count:
        cases = []
        for label, each in zip(labels, answers, strict=True):
            states = []
            for payload in each.asked:
                state = State.allocate(**each.description.state_lengths)
                state.load(payload)
                states.append((state,))
            each.controller.now = time.perf_counter_ns
            each.controller.reset(states[0][0], None)
            cases.append(Case(label, each.controller.step, states))
        samples = blocks * max(1, count // blocks - SETTLE)
        times = time_cases(cases, samples, blocks, batches=False)
    return {
        "rows": [
            {
                "label": label,
                "step_us": summary(times[label].single.ravel() if times else np.empty(0)),
                "times_first": times[label].times(times[labels[0]]) if times else None,
            }
            for label in labels
        ],
        "blocks": blocks,
        "machine": machine_block(),
    }


def _asked(log: Log) -> list[bytes]:
    """States of one session that asked; each tick once."""
    state = State.allocate(**log.description.state_lengths)
    sessions: dict[int, dict[int, bytes]] = {}
    for record in log.records(Kind.STATE):
        state.load(record.payload)
        if state.mode == State.ACTIVE:
            sessions.setdefault(state.session_id, {}).setdefault(state.tick, record.payload)
    counts = Counter({session: len(found) for session, found in sessions.items()})
    return list(sessions[counts.most_common(1)[0][0]].values()) if counts else []
