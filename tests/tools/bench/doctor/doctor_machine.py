"""Fake machines for the doctor: files below a folder, and calls that do as they are told."""

from __future__ import annotations

from pathlib import Path

from hoap3.protocol.runtime.clock import VirtualClock
from hoap3.tools.bench.doctor.system import System

OK, ADVICE, PROBLEM = "ok", "advice", "problem"
CPU = "sys/devices/system/cpu"


def machine(root: Path, files: dict[str, str], **calls: object) -> System:
    """A machine that consists of these files and grants nothing that is not in `calls`."""
    for name, content in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(content + "\n")
    granted = {
        "limit": lambda _: (0, 0),
        "fifo": lambda _: "Operation not permitted",
        "kernel_cache": lambda: (Path("/cache/kernels-1"), True),
        "free": lambda _: 10**11,
        "write_speed": lambda _: 1e8,
        "clock": VirtualClock(),
    }
    return System(root, root / "logs", **{**granted, **calls})


class LateClock(VirtualClock):
    """Costs 100 ns a reading; every sleep ends too late by what comes next."""

    def __init__(self, late: list[int]) -> None:
        super().__init__()
        self._late = late

    def now(self) -> int:
        self.advance(100)
        return super().now()

    def sleep_until(self, deadline: int) -> None:
        super().sleep_until(deadline + self._late[0])
        self._late.append(self._late.pop(0))
