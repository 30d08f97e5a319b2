"""Files of a comparison: those that two runs share to the byte, and the times apart from them."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

from hoap3.tools.compare.comparison import Comparison
from hoap3.tools.compare.figures import WORDS, value
from hoap3.tools.compare.page import page
from hoap3.tools.logs.atomic_write import whole_file
from hoap3.tools.show.result_folder import unwritable

RESULT = "compare.json"
TIMING = "timing.json"


def write(made: Comparison, folder: Path) -> list[Path]:
    """Write all files into a folder that holds no comparison yet; see `make_folder`.

    Raises:
        ConfigError: the folder cannot be written.
    """
    texts = {
        RESULT: as_text(made.as_json()),
        "compare.csv": _csv(made),
        "compare.html": page(made),
    }
    if made.timing is not None:
        texts[TIMING] = as_text(made.timing)
    try:
        for name, text in texts.items():
            with whole_file(folder / name) as draft:
                draft.write_text(text, encoding="utf-8", errors="replace")
    except OSError as error:
        raise unwritable(folder, error) from error
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
