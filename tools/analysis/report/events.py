"""Events of a log as text, and how often and for how long each condition held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis.event_words import CONDITIONS, event_name, in_words
from hoap3.tools.logs.log import Log

MOST = 200  # rows that a reader is given; the log has all
_OFTEN = {Event.schema.constants[name] for name in ("SKIPPED", "OVERWRITTEN", "HOST_STALL")}
_BEGAN = Event.schema.constants["CONDITION_BEGAN"]


@dataclass(frozen=True)
class LogEvent:
    """One event, or many of a kind that happens often.

    Attributes:
        side: of the log.
        tick: that it names; the first one, of many.
        stamp: clock of that side [ns]; likewise.
        name, detail: in words.
        times: how many there are.
    """

    side: str
    tick: int
    stamp: int
    name: str
    detail: str
    times: int = 1


def read_events(log: Log) -> list[LogEvent]:
    """Events of one side in order; those that come by the hundred are one line a kind.

    Conditions are left out: they have a table of their own.
    """
    _, events = log.table(Kind.EVENT)
    joints = log.joint_names
    found: list[LogEvent] = []
    often: dict[int, list[int]] = {}
    first: dict[int, tuple[int, int]] = {}
    for row in events:
        kind, tick, stamp, detail = (int(row[n]) for n in ("kind", "tick", "stamp", "detail"))
        if kind in CONDITIONS:
            continue
        if kind in _OFTEN:
            often.setdefault(kind, []).append(detail)
            first.setdefault(kind, (tick, stamp))
        else:
            name = event_name(kind, detail)
            found.append(LogEvent(log.side, tick, stamp, name, in_words(kind, detail, joints)))
    for kind, details in often.items():
        tick, stamp = first[kind]
        text = in_words(kind, max(details), joints)
        if len(details) > 1:
            whole = in_words(kind, sum(details), joints)
            text = f"{whole} in all, {text.rpartition(': ')[2]} at most at once"
        found.append(LogEvent(log.side, tick, stamp, event_name(kind, 0), text, len(details)))
    return sorted(found, key=lambda event: event.stamp)


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
