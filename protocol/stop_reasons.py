"""Why a robot stops: the reasons that its events and its status name, and each in words."""

from __future__ import annotations

from hoap3.protocol.config.endpoints import Place
from hoap3.protocol.messages import Event

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


def stop_words(reason: str | None) -> str:
    """That a robot is stopped until somebody recovers it, and why.

    Args:
        reason: by name; None where it is not known. What is not known here stays as it is.
    """
    why = f" ({_WORDS.get(reason, reason)})" if reason else ""
    return f"{'stopped' if reason == 'command' else 'safe stop'}{why}"


def recovery_words(robot: str, connect: str | None) -> str:
    """What lets such a robot move again.

    Args:
        robot: its name.
        connect: where it is reached; None for the robot of that name on this machine.
    """
    where = f" --connect {connect}" if connect else ""
    where += " --secure DIR" if isinstance(connect, Place) else ""
    return f"once it is at rest, `hoap3 recover {robot}{where}` lets it move again"
