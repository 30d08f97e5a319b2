"""Folders for results: a new one each time, named by the time; no earlier result is replaced.

A run that was refused at its start leaves no log, so that the corrected command can take its place.
"""

from __future__ import annotations

import atexit
import time
from pathlib import Path

from hoap3.protocol.errors import ConfigError
from hoap3.tools.logs.files import whole_file


def new_name(base: Path) -> Path:
    """A path in `base` that is named by the local time, and does not exist."""
    stamp = time.strftime("%Y%m%d-%H%M%S")
    folder, number = base / stamp, 1
    while folder.exists():
        number += 1
        folder = base / f"{stamp}-{number}"
    return folder


def remove_if_empty(folder: Path) -> None:
    """At the end of this process remove what is made for a folder, if nothing is in it."""
    for each in (*reversed(folder.parents), folder):
        if not each.exists():
            atexit.register(_remove, each)


def _remove(folder: Path) -> None:
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def make_folder(folder: Path, result: str) -> None:
    """Make a folder for results, before minutes of work rather than after.

    Args:
        folder: it may exist.
        result: the file that a finished result has.

    Raises:
        ConfigError: it cannot be made or written, or holds a result already.
    """
    if (folder / result).exists():
        problem = f"holds {result} already, which is not replaced"
        raise ConfigError("--out", "", str(folder), problem, "Name another folder, or remove it")
    try:
        remove_if_empty(folder)
        folder.mkdir(parents=True, exist_ok=True)
        with whole_file(folder / ".try") as draft:
            draft.touch()
        (folder / ".try").unlink()
    except OSError as error:
        raise unwritable(folder, error) from error


def unwritable(folder: Path, error: OSError) -> ConfigError:
    """The error for a folder that cannot be written."""
    reason = error.strerror or "no reason given"
    return ConfigError(
        "--out", "", str(folder), f"cannot be written: {reason}", "Name another folder"
    )
