"""Deletes the logs of old runs, by age and by size, and no log that is being written."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hoap3.tools.logs.files import is_locked
from hoap3.tools.logs.motion_files import LOG_SUFFIX

RUN_FOLDER = re.compile(r"\d{8}-\d{6}(-\d+)?")
"""How `result_folder.new_name` calls them."""
DAY_S = 86_400.0


@dataclass(frozen=True)
class Run:
    """The logs of one run.

    Attributes:
        folder: that they lie in; other files there are none of ours.
        logs: of both sides, all parts.
        size: bytes of them together.
        written: when one of them was written last [s since 1970].
    """

    folder: Path
    logs: tuple[Path, ...]
    size: int
    written: float

    @property
    def in_use(self) -> bool:
        """Whether somebody writes one of them, or may do so: locks are not known everywhere."""
        return any(map(is_locked, (self.folder, *self.logs)))

    def delete(self) -> None:
        """Delete them, and the folder where nothing else is in it.

        Raises:
            OSError: it is not allowed.
        """
        for log in self.logs:
            log.unlink(missing_ok=True)
        try:
            self.folder.rmdir()
        except FileNotFoundError:
            return  # another service was quicker
        except OSError:
            if not any(self.folder.iterdir()):
                raise


@dataclass
class Pruned:
    """What was deleted, and what could not be.

    Attributes:
        runs: deleted, oldest first.
        size: bytes that they took.
        kept: why others are still there.
    """

    runs: list[Path]
    size: int
    kept: list[str]

    def __str__(self) -> str:
        """In words; empty where nothing happened."""
        said = []
        if self.runs:
            n = len(self.runs)
            what = f"{n} old run{'s' if n > 1 else ''}, {self.size / 1e6:.1f} MB"
            said.append(f"deleted the logs of {what}")
        return "; ".join([*said, *self.kept])


def prune(
    directory: Path,
    *,
    now: float,
    keep_days: float | None = None,
    keep_mb: float | None = None,
    spare: Path | None = None,
) -> Pruned:
    """Delete the logs of runs that are too old, then the oldest until the rest is small enough.

    Args:
        directory: that holds a folder a run, named by its time; other folders are left alone.
        now: the time [s since 1970].
        keep_days: age beyond which a run goes [days]; None: none does.
        keep_mb: of all runs together; None: any size.
        spare: the folder of a run that begins.
    """
    found = Pruned([], 0, [])
    if keep_days is None and keep_mb is None:
        return found
    runs = sorted(_runs(directory), key=lambda run: (run.written, run.folder.name))
    total = sum(run.size for run in runs)
    for run in runs:
        too_old = keep_days is not None and now - run.written > keep_days * DAY_S
        too_much = keep_mb is not None and total > keep_mb * 1e6
        if not (too_old or too_much):
            continue
        if (spare is not None and run.folder.resolve() == spare.resolve()) or run.in_use:
            continue
        try:
            run.delete()
        except OSError as error:
            found.kept.append(f"{run.folder} cannot be deleted: {error.strerror or error}")
            continue
        total -= run.size
        found.runs.append(run.folder)
        found.size += run.size
    return found


def _runs(directory: Path) -> Iterator[Run]:
    """Runs whose logs can be looked at; those of others may go meanwhile."""
    try:
        entries = [
            Path(entry) for entry in os.scandir(directory) if entry.is_dir(follow_symlinks=False)
        ]
    except OSError:
        return
    for folder in entries:
        if not RUN_FOLDER.fullmatch(folder.name):
            continue
        try:
            logs = [path for path in folder.iterdir() if path.suffix == LOG_SUFFIX]
            stats = [path.stat() for path in logs]
        except OSError:
            continue
        if logs:
            size, written = sum(s.st_size for s in stats), max(s.st_mtime for s in stats)
            yield Run(folder, tuple(logs), size, written)
