"""Make the logs that both revisions read, once for each comparison, by the old revision."""

from __future__ import annotations

import shutil
from pathlib import Path

from .cases import LOGS, Case
from .damage import DAMAGES
from .outputs import run_case
from .realtime import record_realtime
from .revision import Revision

DAMAGED = "lockstep/qp12"  # which log is damaged


def make_logs(cases: list[Case], revision: Revision, folder: Path) -> None:
    """Make every log that one of the cases reads, each in a folder of its name."""
    wanted = dict.fromkeys(name for case in cases for name in case.logs)
    if any(name.startswith("damaged/") for name in wanted):
        wanted = {DAMAGED: None, **wanted}
    for name in wanted:
        print(f"make log {name}", flush=True)
        make_log(name, revision, folder)


def make_log(name: str, revision: Revision, folder: Path) -> None:
    """Make one log."""
    command, target = LOGS[name], folder / name
    kind, _, what = name.partition("/")
    if command is not None:
        run_case(Case(name, (command,)), revision, target, folder)
    elif kind == "realtime":
        record_realtime(revision, target, stalls=what == "stalls")
    else:
        shutil.copytree(folder / DAMAGED, target)
        DAMAGES[what](target / "log")
