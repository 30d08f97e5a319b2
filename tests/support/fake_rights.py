"""Processes that keep a CPU awake without any right: its setting is a file of the test."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

OTHER_MACHINE = Path(__file__).parent / "other_machine"
BEFORE = "40"


class FakeCpu:
    """CPU 0 of a machine that grants everything, and the runtime directory of its user.

    Attributes:
        environment: for the processes that believe it.
        runtime: their directory for locks and notes.
    """

    def __init__(self, folder: Path) -> None:
        self._setting = folder / "cpus" / "cpu0" / "power" / "pm_qos_resume_latency_us"
        self._setting.parent.mkdir(parents=True)
        self._setting.write_text(BEFORE + "\n")
        self.runtime = folder / "runtime"
        self.runtime.mkdir(mode=0o700)
        path = os.pathsep.join([str(OTHER_MACHINE), *filter(None, [os.getenv("PYTHONPATH")])])
        self.environment = {
            "PYTHONPATH": path,
            "FAKE_CPUS": str(folder / "cpus"),
            "HOAP3_RUNTIME_DIR": str(self.runtime),
        }

    @property
    def setting(self) -> str:
        """What is set now; `n/a` keeps it awake."""
        return self._setting.read_text().strip()

    def assert_nothing_left(self) -> None:
        """The CPU may sleep as before; no note is left, and no lock is held."""
        assert self.setting == BEFORE
        for path in filter(Path.is_file, self.runtime.iterdir()):
            assert path.read_bytes() == b""
            with path.open() as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
