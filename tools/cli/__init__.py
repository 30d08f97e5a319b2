"""The command line: one file for each group of commands; it only wires.

Where it is the program, Ctrl-C while a module is being imported ends the process at once: an
exception there would turn into an ImportError of somebody's library, or vanish in one.
"""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

if sys.platform != "linux":  # before modules that import what only Linux has
    sys.stderr.write(f"error: hoap3 needs Linux (found {sys.platform!r}). Use Linux or WSL\n")
    sys.exit(2)


def _interrupt(number: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        frame = frame.f_back
    raise KeyboardInterrupt


if os.path.basename(sys.argv[0]) in {"hoap3", "-m"}:
    signal.signal(signal.SIGINT, _interrupt)
