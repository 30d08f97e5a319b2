"""Where processes listen, as the kernel has it."""

from __future__ import annotations

import ipaddress
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

from support.command_bench import Command

LISTEN = 0x0A
TABLES = ("tcp", "tcp6", "udp", "udp6")


def addresses(pid: int) -> set[str]:
    """Addresses on which a process listens (TCP), or could be sent to (UDP)."""
    open_now = _read(lambda: list(Path(f"/proc/{pid}/fd").iterdir())) or ()
    handles = {_read(handle.readlink) for handle in open_now}
    found = set()
    for name in TABLES:
        for row in (_read(Path(f"/proc/{pid}/net/{name}").read_text) or "").splitlines()[1:]:
            fields = row.split()
            listens = name.startswith("udp") or int(fields[3], 16) == LISTEN
            if listens and Path(f"socket:[{fields[9]}]") in handles:
                found.add(_readable(fields[1].split(":")[0]))
    return found


def _read(what: Callable[[], Any]) -> Any:
    """What is found, or None where it is gone meanwhile."""
    try:
        return what()
    except (FileNotFoundError, ProcessLookupError):
        return None


def _readable(text: str) -> str:
    """The kernel's hexadecimal words, each in the byte order of the machine."""
    words = [int(text[at : at + 8], 16) for at in range(0, len(text), 8)]
    return str(ipaddress.ip_address(struct.pack(f"={len(words)}I", *words)))


def census(command: Command) -> set[str]:
    """Where the command and all its descendants listen."""
    found = addresses(command.process.pid)
    for pid in command.family():
        found |= addresses(pid)
    return found


def assert_loopback_only(found: set[str]) -> None:
    assert all(ipaddress.ip_address(address).is_loopback for address in found), found
