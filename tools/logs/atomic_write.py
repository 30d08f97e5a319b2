"""Files that are there whole, or not at all: a full disk leaves what was there before."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """Where to write what shall become `target`; it replaces it in one step, at the end.

    What is no ordinary file, such as a pipe, is written to directly.

    Raises:
        OSError: the place cannot be written; nothing is left behind.
    """
    if target.exists() and not target.is_file():
        yield target
        return
    real = target.resolve()  # a link stays one
    draft = real.with_name(f".{real.name}.{os.getpid()}")
    try:
        yield draft
        draft.replace(real)
    finally:
        draft.unlink(missing_ok=True)
