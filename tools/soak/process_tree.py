"""What the processes below one of ours hold, as the kernel tells: memory, descriptors, threads."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

PROC = Path("/proc")
APP, OBSERVER = "hoap3.tools.cli.app", "hoap3.tools.services.observer"
STALLS = "hoap3.tools.machine.stalls"
SERVICES = {"emulator": "robot", "controller": "controller"}


@dataclass(frozen=True)
class Holdings:
    """What a process holds.

    Attributes:
        rss_bytes: memory that is in RAM, shared pages included. From `status`: `smaps_rollup` would
            hold a lock of the process while its pages are walked.
        descriptors: open files.
        threads: of it.
    """

    rss_bytes: int
    descriptors: int
    threads: int


def descendants(pid: int) -> dict[int, int]:
    """Every process below this one, and its parent; parents come first."""
    children: dict[int, list[int]] = {}
    for entry in os.listdir(PROC):
        if entry.isdecimal():
            parent = _parent(entry)
            if parent is not None:
                children.setdefault(parent, []).append(int(entry))
    found: dict[int, int] = {}
    above = [pid]
    for parent in above:
        for child in sorted(children.get(parent, [])):
            found[child] = parent
            above.append(child)
    return found


def holdings(pid: int) -> Holdings | None:
    """What a process holds; None where it has ended."""
    try:
        facts = _status(pid)
        kilobytes, threads = facts["VmRSS"].split()[0], facts["Threads"]
        descriptors = len(os.listdir(PROC / str(pid) / "fd"))
    except (OSError, KeyError):  # what has ended has no memory
        return None
    return Holdings(1024 * int(kilobytes), descriptors, int(threads))


def name_of(pid: int, parent: str) -> str:
    """What people call a process, by its command line and the name of its parent."""
    try:
        words = (PROC / str(pid) / "cmdline").read_bytes().decode(errors="replace").split("\0")
        cpu = _status(pid).get("Cpus_allowed_list", "?")
    except OSError:
        return f"process {pid}"
    module, *rest = words[words.index("-m") + 1 :] if "-m" in words else words
    if module == APP and rest and rest[0] in SERVICES:
        return SERVICES[rest[0]]
    if module == OBSERVER:
        return f"observer of the {parent}"
    return f"stall monitor of CPU {cpu}" if module == STALLS else Path(module).name


def _parent(pid: str) -> int | None:
    try:
        stat = (PROC / pid / "stat").read_bytes()
    except OSError:
        return None  # it has ended
    return int(stat.rpartition(b")")[2].split()[1])  # its name may have any sign in it


def _status(pid: int) -> dict[str, str]:
    text = (PROC / str(pid) / "status").read_text(encoding="utf-8", errors="replace")
    pairs = (line.partition(":") for line in text.splitlines())
    return {key: value.strip() for key, _, value in pairs}
