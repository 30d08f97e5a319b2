"""Open loop: every controller answers the States of one log; nothing is applied."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import LogError
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.config import build
from hoap3.remote_controller.controllers.base import Controller
from hoap3.remote_controller.loop import failure
from hoap3.tools.compare.answers import MOST_TIMED, Answers, table
from hoap3.tools.compare.candidates import Candidate
from hoap3.tools.logs.log import Log
from hoap3.tools.report.sources import Sources, of_ours


@dataclass(frozen=True)
class RecordedStates:
    """The States of a log that asked for an answer.

    Attributes:
        description: of the robot.
        payloads: States of one session in which the robot was active, in order.
    """

    description: RobotDescription
    payloads: list[bytes]


def read_asked(path: Path) -> RecordedStates:
    """Read the States of a log: of the session with most of them that asked.

    Args:
        path: folder of a run, or one `*.mcap`; of a run, the robot's log if there is one.

    Raises:
        LogError: no log of ours, or none in which a robot was active.
    """
    with of_ours(path):
        for log in Sources.open(path).logs:
            found = _asked(log)
            if found:
                return RecordedStates(log.description, found)
    raise LogError(
        f"{path}: no State in it asks for an answer: the robot was never active. Name the log of "
        "a run with motion"
    )


class OpenLoop:
    """One controller, asked again what the log's was asked.

    Args:
        candidate: the controller.
        asked: States of the log.

    Raises:
        UsageError: the controller cannot be built for the robot of the log.
    """

    def __init__(self, candidate: Candidate, asked: RecordedStates) -> None:
        self._asked = asked
        self._controller: Controller = build(candidate.config, asked.description, candidate.words)

    def run(self) -> Answers:
        """Answer all States, from a reset at the first.

        Raises:
            Hoap3Error: the controller failed; names the tick.
        """
        asked, controller = self._asked, self._controller
        clock = VirtualClock()
        controller.now = clock.now
        state = state_for(asked.description)
        answers: list[bytes] = []
        for payload in asked.payloads:
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
            description=asked.description,
            controller=controller,
            states=table(asked.payloads, State),
            setpoints=table(answers, Setpoint),
            asked=asked.payloads[:MOST_TIMED],
            closed_loop=False,
        )


def state_for(description: RobotDescription) -> State:
    """An empty State of a robot."""
    return State.allocate(**description.state_lengths)


def _asked(log: Log) -> list[bytes]:
    """States of one session that asked; each tick once."""
    state = state_for(log.description)
    sessions: dict[int, dict[int, bytes]] = {}
    for record in log.records():
        if record.kind == Kind.STATE:
            state.load(record.payload)
            if state.mode == State.ACTIVE:
                sessions.setdefault(state.session_id, {}).setdefault(state.tick, record.payload)
    counts = Counter({session: len(found) for session, found in sessions.items()})
    return list(sessions[counts.most_common(1)[0][0]].values()) if counts else []
