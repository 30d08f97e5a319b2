"""The events of a log, in words: what happened, and what the number beside it means."""

from __future__ import annotations

from dataclasses import dataclass

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log
from hoap3.tools.show.event_words import CONDITIONS, event_name, in_words

MOST = 200  # rows that a reader is given; the log has all
_OFTEN = {Event.schema.constants[name] for name in ("SKIPPED", "OVERWRITTEN", "HOST_STALL")}


@dataclass(frozen=True)
class Happening:
    """One event, or many of a kind that happens often.

    Attributes:
        side: whose log tells it.
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


def read_happenings(log: Log) -> list[Happening]:
    """Events of one side in order; those that come by the hundred are one line a kind.

    Conditions are left out: they have a table of their own.
    """
    _, events = log.table(Kind.EVENT)
    joints = log.joint_names
    found: list[Happening] = []
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
            found.append(Happening(log.side, tick, stamp, name, in_words(kind, detail, joints)))
    for kind, details in often.items():
        tick, stamp = first[kind]
        text = in_words(kind, max(details), joints)
        if len(details) > 1:
            whole = in_words(kind, sum(details), joints)
            text = f"{whole} in all, {text.rpartition(': ')[2]} at most at once"
        found.append(Happening(log.side, tick, stamp, event_name(kind, 0), text, len(details)))
    return sorted(found, key=lambda happening: happening.stamp)
