"""Conditions of the controller: how often each held, for how many ticks, and when at first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log
from hoap3.tools.show.event_words import CONDITIONS, in_words

_BEGAN = Event.schema.constants["CONDITION_BEGAN"]


@dataclass(frozen=True)
class Condition:
    """One that held at least once in a session.

    Attributes:
        condition: its name.
        times: how often it began.
        ticks: for how many ticks of the robot it held in all.
        first_tick: at which it held for the first time.
        longest: most ticks in a row.
    """

    condition: str
    times: int
    ticks: int
    first_tick: int
    longest: int


def read_conditions(log: Log, session_id: int | None = None) -> list[Condition]:
    """Those of one session in a controller's log, the most lasting first.

    One whose begin is lost with older files counts from the first State of the log; one that goes
    on counts to the last.

    Args:
        log: of the controller.
        session_id: of the robot; None for the session of the last event.
    """
    _, events = log.table(Kind.EVENT)
    events = events[np.isin(events["kind"], list(CONDITIONS))]
    if not len(events):
        return []
    session = int(events["session_id"][-1]) if session_id is None else session_id
    events = events[events["session_id"] == session]
    states = log.states()
    ticks = states["tick"][states["session_id"] == session]
    first, last = (int(ticks.min()), int(ticks.max())) if len(ticks) else (0, 0)
    names, stretches = log.names("conditions"), dict[int, list[tuple[int, int]]]()
    open_since: dict[int, int] = {}
    for event in events:
        kind, tick, number = int(event["kind"]), int(event["tick"]), int(event["detail"])
        found = stretches.setdefault(number, [])
        if kind == _BEGAN:
            open_since.setdefault(number, tick)
        elif number in open_since or not found:
            found.append((open_since.pop(number, first), tick))
    for number, since in open_since.items():
        stretches[number].append((since, last + 1))
    held = [
        _condition(in_words(_BEGAN, number, (), names), found)
        for number, found in stretches.items()
    ]
    return sorted(held, key=lambda each: (-each.ticks, each.first_tick, each.condition))


def _condition(name: str, stretches: list[tuple[int, int]]) -> Condition:
    """From its stretches, each from the first tick to the one after the last."""
    lengths = [max(0, end - begin) for begin, end in stretches]
    return Condition(name, len(stretches), sum(lengths), stretches[0][0], max(lengths))
