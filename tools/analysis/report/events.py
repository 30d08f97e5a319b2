"""Events of a log as text, and how often and for how long each condition held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.analysis.event_words import CONDITIONS, event_name, in_words
from hoap3.tools.analysis.report.changes import read_changes
from hoap3.tools.logs.log import Log

MOST = 200  # rows that a reader is given; the log has all
_OFTEN = {Event.schema.constants[name] for name in ("SKIPPED", "OVERWRITTEN", "HOST_STALL")}
_BEGAN, _CHANGED = (Event.schema.constants[name] for name in ("CONDITION_BEGAN", "CHANGED"))


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
    changes = iter(read_changes(log) if (events["kind"] == _CHANGED).any() else ())
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
            text = (next(changes, "") if kind == _CHANGED else "") or in_words(kind, detail, joints)
            found.append(LogEvent(log.side, tick, stamp, event_name(kind, detail), text))
    for kind, details in often.items():
        tick, stamp = first[kind]
        text = in_words(kind, max(details), joints)
        if len(details) > 1:
            whole = in_words(kind, sum(details), joints)
            text = f"{whole} in all, {text.rpartition(': ')[2]} at most at once"
        found.append(LogEvent(log.side, tick, stamp, event_name(kind, 0), text, len(details)))
    return sorted(found, key=lambda event: event.stamp)


@dataclass(frozen=True)
class Interval:
    """Ticks in which a condition held without a break.

    Attributes:
        condition: its name.
        begin: its first tick.
        end: the tick after its last one; with `goes_on` after the last State of the log.
        goes_on: whether its end is not in the log.
    """

    condition: str
    begin: int
    end: int
    goes_on: bool = False

    @property
    def ticks(self) -> int:
        """For how many ticks of the robot it held."""
        return max(0, self.end - self.begin)


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


def read_intervals(log: Log, session_id: int | None = None) -> list[Interval]:
    """When conditions of one session in a controller's log held, in the order of their begins.

    One whose begin is lost with older files counts from the first State of the log.

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
    names, found = log.names("conditions"), list[Interval]()
    open_since, ended = dict[int, int](), set[int]()
    for event in events:
        kind, tick, number = int(event["kind"]), int(event["tick"]), int(event["detail"])
        if kind == _BEGAN:
            open_since.setdefault(number, tick)
        elif number in open_since or number not in ended:
            name = in_words(_BEGAN, number, (), names)
            found.append(Interval(name, open_since.pop(number, first), tick))
            ended.add(number)
    for number, since in open_since.items():
        name = in_words(_BEGAN, number, (), names)
        found.append(Interval(name, since, last + 1, goes_on=True))
    return sorted(found, key=lambda each: (each.begin, each.condition))


def sum_up_conditions(intervals: Sequence[Interval]) -> list[Condition]:
    """Sum up each condition, the most lasting first."""
    found: dict[str, list[Interval]] = {}
    for each in intervals:
        found.setdefault(each.condition, []).append(each)
    held = [
        Condition(
            name,
            len(alike),
            sum(each.ticks for each in alike),
            alike[0].begin,
            max(each.ticks for each in alike),
        )
        for name, alike in found.items()
    ]
    return sorted(held, key=lambda each: (-each.ticks, each.first_tick, each.condition))
