"""What was refused at the start leaves no log, so that the corrected command can take its place."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any


def is_new(out: Path | None) -> bool:
    """Whether the folder of a log will be made, before it is."""
    return out is None or not out.exists()


def nothing_happened(final: Mapping[str, Any]) -> bool:
    """Whether a log holds no State: an observer that died has not told, and its log is kept."""
    return final.get("states") == 0


def forget(finals: Iterable[Mapping[str, Any]], folder: Path | None, *, made: bool) -> None:
    """Remove the logs of observers that have ended, and their folder if nothing else is there.

    Args:
        finals: what the observers told at their ends.
        folder: of the logs, or None where there are none.
        made: whether the folder was made for them.
    """
    for final in finals:
        for path in final.get("paths", ()):
            Path(path).unlink(missing_ok=True)
    if folder is not None and made:
        with suppress(OSError):  # something else lies there
            folder.rmdir()
