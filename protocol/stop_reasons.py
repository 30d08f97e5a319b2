"""Why a robot stops: the reasons that its events and its status name, and each in words."""

from __future__ import annotations

from protocol.messages import Event

_CONSTANTS = Event.schema.constants

STOP_REASONS = {
    value: name.removeprefix("REASON_").lower()
    for name, value in _CONSTANTS.items()
    if name.startswith("REASON_")
}
"""Name of each reason, by its number in an Event."""

LATCHING = frozenset({"misses", "holder_lost", "command"})
"""Those after which a robot that goes on stays stopped until somebody recovers it."""

_WORDS = {
    "misses": "too many answers in a row were not in time",
    "holder_lost": "its controller was lost",
    "command": "somebody asked for it",
    "shutdown": "its service ends",
    "released": "its controller gave authority back",
    "ended": "its duration is over",
}


def waits_for_recovery(mode: str, reason: str | None) -> bool:
    """Whether a robot stays at rest until somebody recovers it.

    Args:
        mode: as its status has it.
        reason: likewise; None where it does not tell, as older robots do not.
    """
    return reason in LATCHING or (reason is None and mode == "stopped")


def stop_words(robot: str, reason: str | None) -> str:
    """Why a robot stands in its safe stop, and what frees it.

    Args:
        robot: its name.
        reason: by name; None where it is not known. What is not known here stays as it is.
    """
    why = f" ({_WORDS.get(reason, reason)})" if reason else ""
    return f"safe stop{why}: `hoap3 recover {robot}` frees it"
