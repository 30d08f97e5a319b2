"""Which software computes the answers: its versions, and a hash of our own sources."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from hoap3.tools.machine.machine import versions

ROOMS = ("protocol", "remote_controller")
"""Rooms whose sources decide an answer."""

SOURCES = ("*.py", "*.msg")
OURS = "source"
NOT_LOGGED = "not in the log"
LONGEST = 40  # characters of a version that a log gives


def software() -> dict[str, str]:
    """Versions of all that decides an answer, and our own sources as `source`, 12 digits."""
    return {**versions(), OURS: source_hash()}


def source_hash() -> str:
    """Hash of the names and texts of our sources, 12 hexadecimal digits."""
    house = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for room in ROOMS:
        for path in sorted(path for kind in SOURCES for path in (house / room).rglob(kind)):
            digest.update(str(path.relative_to(house)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:12]


def differences(logged: Mapping[str, str]) -> dict[str, list[str]]:
    """Versions that are not those of a log, by name: the log's, and the present one.

    Args:
        logged: versions by name, as the log has them. Of what it does not name only our own
            sources are a difference: nobody can tell that they are the same.
    """
    now = software()
    logged = {OURS: NOT_LOGGED, **logged}
    return {
        name: [then[:LONGEST], now[name]]
        for name, then in logged.items()
        if name in now and then != now[name]
    }


def in_words(found: Mapping[str, list[str]]) -> str:
    """What `differences` found, in one line; "" for nothing."""
    if not found:
        return ""
    parts = [_part(name, then, now) for name, (then, now) in found.items()]
    return f"the software is not that of the log ({'; '.join(parts)})"


def _part(name: str, then: str, now: str) -> str:
    if name != OURS:
        return f"{name} {then}, now {now}"
    logged = then if then == NOT_LOGGED else f"hash {then}"
    return f"our own code ({logged}, now hash {now})"
