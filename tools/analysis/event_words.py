"""Events in words: what happened, and what the number beside it means."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Literal

from hoap3.protocol.messages import Event
from hoap3.robot_emulator.setpoint_validator import REJECTION_KINDS

_CONSTANTS = Event.schema.constants
JOINT = 0xFFFF
"""Of the detail of CLIPPED: the joint; the limit that acted stands above it, 0 in old logs."""
MOST_ERRNO = 4096  # anybody may publish an event with another detail
EVENT_NAMES = {
    value: name
    for name, value in _CONSTANTS.items()
    if not name.startswith(("REASON_", "WIRE_", "LIMIT_"))
}
_NAMES = {value: name.lower().replace("_", " ") for value, name in EVENT_NAMES.items()}
_DETAILS = {
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
    "CHANGED": "after tick {}",
    "CONFLICTING_SETPOINTS": "{} so far: another client sends setpoints in the holder's name",
    "STALLS_WATCHED": "CPU {}",
    "NAME_CONFLICT": "other robots with this name: {}; no new grants while there are any",
    "STARTED": "",
    "ENDED": "",
    "RECOVERED": "",
}


def _numbers(*names: str) -> set[int]:
    return {_CONSTANTS[name] for name in names}


def _names(prefix: str) -> dict[int, str]:
    """Constants with a prefix, by their number, as text."""
    found = {value: name for name, value in _CONSTANTS.items() if name.startswith(prefix)}
    return {n: name.removeprefix(prefix).lower().replace("_", " ") for n, name in found.items()}


_REASONS, _LIMITS = _names("REASON_"), _names("LIMIT_")
CONDITIONS = _numbers("CONDITION_BEGAN", "CONDITION_ENDED")
_OF_JOINTS = _numbers("CLIPPED", "TORQUE_LIMITED")
_ROUTINE = _numbers(
    *("STARTED", "GRANTED", "RELEASED", "AT_REST", "ENDED", "RESET"),
    *("ROBOT_FOUND", "ROBOT_LOST", "STALLS_WATCHED"),
)
_CALM = _numbers("RECOVERED", "CHANGED", "CONDITION_ENDED")
_GRAVE = _numbers("CONTROLLER_FAILED", "LOG_LOST")
_FORCED = _numbers("REASON_MISSES", "REASON_HOLDER_LOST")
_ORDERLY = _numbers("REASON_ENDED", "REASON_SHUTDOWN")


def is_routine(kind: int, detail: int) -> bool:
    """Whether an event is part of every run that goes well."""
    return kind in _ROUTINE or (kind == _CONSTANTS["SAFE_STOP"] and detail in _ORDERLY)


def severity(kind: int, detail: int) -> Literal["info", "warning", "error"]:
    """How bad an event is; a safe stop that misses or a lost holder forced is an error."""
    if kind in _GRAVE or (kind == _CONSTANTS["SAFE_STOP"] and detail in _FORCED):
        return "error"
    return "info" if kind in _CALM or is_routine(kind, detail) else "warning"


def event_name(kind: int, detail: int) -> str:
    """What happened. A safe stop is one that misses or a lost holder forced; others only brake."""
    if kind == _CONSTANTS["SAFE_STOP"] and detail not in _FORCED:
        return "braking"
    return _NAMES.get(kind, f"unknown event {kind}")


def page_event(
    event: Event, at_s: float, joints: Sequence[str], conditions: Sequence[str] = ()
) -> dict[str, Any]:
    """An event as the live page lists it; the last arguments as for `in_words`."""
    name = event_name(event.kind, event.detail)
    words = in_words(event.kind, event.detail, joints, conditions)
    return {
        "at_s": round(at_s, 6),
        "label": f"{name}: {words}" if words else name,
        "severity": severity(event.kind, event.detail),
    }


def page_warning(label: str, at_s: float | None = None) -> dict[str, Any]:
    """A message of kind `event` for the live page that warns of something."""
    return {"kind": "event", "at_s": at_s, "label": label, "severity": "warning"}


def named(names: Sequence[str], number: int, kind: str) -> str:
    """The name of a number, or that it is the `kind` of that number."""
    return names[number] if 0 <= number < len(names) else f"{kind} {number}"


def in_words(kind: int, detail: int, joints: Sequence[str], conditions: Sequence[str] = ()) -> str:
    """What the detail of an event means.

    Args:
        kind, detail: of the event.
        joints: of the robot.
        conditions: of the controller, as its session has them.
    """
    if kind in CONDITIONS:
        return named(conditions, detail, "condition")
    if kind == _CONSTANTS["SAFE_STOP"]:
        return _REASONS.get(detail, f"reason {detail}")
    if kind == _CONSTANTS["REFUSED"] and not detail:
        return "the client's liveliness token is not seen"
    if kind == _CONSTANTS["REFUSED"] and detail < 0:
        return "another robot uses the name"
    if kind == _CONSTANTS["REJECTED"]:
        return named(REJECTION_KINDS, detail, "kind")
    if kind == _CONSTANTS["SUPPRESSED"]:
        return f"{detail >> 8} of {event_name(detail & 0xFF, 0)!r}"
    if kind in _OF_JOINTS:
        joint, limit = named(joints, detail & JOINT, "joint"), _LIMITS.get(detail >> 16)
        if kind == _CONSTANTS["TORQUE_LIMITED"]:
            limit = "torque"
        return f"{joint}: {limit} limit" if limit else joint
    if kind == _CONSTANTS["LOG_LOST"]:
        return (
            os.strerror(detail) if 0 < detail < MOST_ERRNO else "its observer ended"
        ) + "; it goes on without"
    if kind == _CONSTANTS["HOST_STALL"]:
        return f"{detail / 1e6:.3g} ms"
    return _DETAILS.get(EVENT_NAMES.get(kind, ""), "{}").format(detail)
