"""What one controller answered, and to what."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import Setpoint, State
from hoap3.protocol.runtime.recorder import Recorder
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.remote_controller.controllers.base import Controller
from hoap3.tools.show.verdicts import judge

Rows = np.ndarray[Any, Any]

MOST_TIMED = 20_000  # answers of which the States are kept as bytes, to be timed on


@dataclass
class RecordedInputs(Recorder):
    """A recorder that keeps the messages of one kind."""

    kind: Kind
    payloads: list[bytes] = field(default_factory=list)

    def record(self, kind: Kind, stamp: int, payload: bytes) -> None:  # noqa: ARG002
        """Keep it, or not."""
        if kind == self.kind:
            self.payloads.append(payload)

    record_large = record


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
        judged: the three verdicts, and what they rest on, as `hoap3.tools.show.verdicts.judge` has
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


def table(payloads: list[bytes], message: type[State] | type[Setpoint]) -> Rows:
    """Messages of one layout as a structured array."""
    schema = message.schema
    if not payloads:
        return np.zeros(0, schema.dtype({}))
    return np.frombuffer(b"".join(payloads), schema.dtype(schema.lengths_in(payloads[0])))
