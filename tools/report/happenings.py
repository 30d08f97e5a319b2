"""The events of a log, in words: what happened, and what the number beside it means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from protocol.errors import LogError
from protocol.messages import Event
from protocol.ring import Kind
from robot_emulator.inbox import REJECTION_KINDS
from tools.log import Log
from tools.report.numbers import number

MOST = 200  # rows that a reader is given; the log has all
_CONSTANTS = Event.schema.constants
_NAMES = {
    value: name.lower().replace("_", " ")
    for name, value in _CONSTANTS.items()
    if not name.startswith(("REASON_", "WIRE_"))
}
_REASONS = {
    value: name.removeprefix("REASON_").lower().replace("_", " ")
    for name, value in _CONSTANTS.items()
    if name.startswith("REASON_")
}
_OFTEN = {_CONSTANTS[name] for name in ("SKIPPED", "OVERWRITTEN", "HOST_STALL")}
_SAYING = {
    "GRANTED": "epoch {}",
    "REFUSED": "epoch {} holds it",
    "RELEASED": "epoch {}",
    "HOLDER_LOST": "epoch {}",
    "AT_REST": "ticks of braking: {}",
    "SKIPPED": "periods: {}",
    "RESET": "at tick {}",
    "ROBOT_FOUND": "epoch {}",
    "ROBOT_LOST": "last tick {}",
    "OVERWRITTEN": "States never seen: {}",
    "CONTROLLER_FAILED": "at tick {}",
    "STALLS_WATCHED": "CPU {}",
    "STARTED": "",
    "ENDED": "",
    "RECOVERED": "",
}
_SAYINGS = {_CONSTANTS[name]: text for name, text in _SAYING.items()}


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
    """Events of one side in order; those that come by the hundred are one line a kind."""
    _, events = log.table(Kind.EVENT)
    joints = _joints(log)
    found: list[Happening] = []
    often: dict[int, list[int]] = {}
    first: dict[int, tuple[int, int]] = {}
    for row in events:
        kind, tick, stamp, detail = (int(row[n]) for n in ("kind", "tick", "stamp", "detail"))
        if kind in _OFTEN:
            often.setdefault(kind, []).append(detail)
            first.setdefault(kind, (tick, stamp))
        else:
            name = _NAMES.get(kind, f"unknown event {kind}")
            found.append(Happening(log.side, tick, stamp, name, in_words(kind, detail, joints)))
    for kind, details in often.items():
        tick, stamp = first[kind]
        text = in_words(kind, max(details), joints)
        if len(details) > 1:
            whole = in_words(kind, sum(details), joints)
            text = f"{whole} in all, {text.rpartition(': ')[2]} at most at once"
        found.append(Happening(log.side, tick, stamp, _NAMES[kind], text, len(details)))
    return sorted(found, key=lambda happening: happening.stamp)


def in_words(kind: int, detail: int, joints: Sequence[str]) -> str:
    """What the detail of an event means."""
    if kind == _CONSTANTS["SAFE_STOP"]:
        return _REASONS.get(detail, f"reason {detail}")
    if kind == _CONSTANTS["REJECTED"]:
        known = 0 <= detail < len(REJECTION_KINDS)
        return REJECTION_KINDS[detail] if known else f"kind {detail}"
    if kind == _CONSTANTS["CLIPPED"]:
        return joints[detail] if 0 <= detail < len(joints) else f"joint {detail}"
    if kind == _CONSTANTS["HOST_STALL"]:
        return f"{number(detail / 1e6)} ms"
    return _SAYINGS.get(kind, "{}").format(detail)


def _joints(log: Log) -> Sequence[str]:
    try:
        return log.description.joint_names
    except LogError:
        return ()
