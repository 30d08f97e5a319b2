"""Files of a comparison: those that two runs share to the byte, and the times apart from them."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

from protocol.errors import ConfigError
from tools.compare.comparison import Comparison
from tools.compare.figures import WORDS, value
from tools.compare.page import page
from tools.whole_file import whole_file

TIMING = "timing.json"


def check_folder(folder: Path) -> None:
    """Make the folder, before minutes of work rather than after.

    Raises:
        ConfigError: it cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with whole_file(folder / ".try") as draft:
            draft.touch()
        (folder / ".try").unlink()
    except OSError as error:
        raise _unwritable(folder, error) from error


def write(made: Comparison, folder: Path) -> list[Path]:
    """Write all files; those of an earlier comparison are replaced, its times removed.

    Raises:
        ConfigError: the folder cannot be written.
    """
    texts = {
        "compare.json": as_text(made.as_json()),
        "compare.csv": _csv(made),
        "compare.html": page(made),
    }
    if made.timing is not None:
        texts[TIMING] = as_text(made.timing)
    try:
        for name, text in texts.items():
            with whole_file(folder / name) as draft:
                draft.write_text(text, encoding="utf-8", errors="replace")
        if made.timing is None:
            (folder / TIMING).unlink(missing_ok=True)
    except OSError as error:
        raise _unwritable(folder, error) from error
    return [folder / name for name in texts]


def as_text(content: dict[str, Any]) -> str:
    """JSON for a file or standard output; nothing in it is nan or inf."""
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def _csv(made: Comparison) -> str:
    """A row for each controller, a column for each figure under its dotted key."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["label", "unit", *(word.key for word in WORDS)])
    for label, found in zip(made.labels, made.figures, strict=True):
        writer.writerow([label, found["unit"], *(value(found, word.key) for word in WORDS)])
    return text.getvalue()


def _unwritable(folder: Path, error: OSError) -> ConfigError:
    reason = error.strerror or "no reason given"
    return ConfigError(
        "--out", "", str(folder), f"cannot be written: {reason}", "Name another folder"
    )
