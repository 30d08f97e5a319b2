"""What a comparison leaves: tables on standard output, and files.

The files are those that two runs share to the byte, and the times apart from them.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from hoap3.tools.analysis.compare.comparison import Comparison
from hoap3.tools.analysis.compare.figures import WORDS, cell, value
from hoap3.tools.analysis.compare.page import page, shown_words, unit
from hoap3.tools.analysis.numbers import number
from hoap3.tools.analysis.output import results
from hoap3.tools.analysis.result_folder import unwritable
from hoap3.tools.logs.files import whole_file

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


def show(made: Comparison, files: Sequence[Path]) -> None:
    """Print figures, times, findings, and where the files are."""
    table = Table(box=None, pad_edge=False)
    _columns(table, made.labels)
    for word in shown_words(made):
        shown = unit(word.unit, made)
        name = f"{word.name} [{shown}]" if shown else word.name
        cells = [cell(found, word.key) for found in made.figures]
        table.add_row(escape(name), *map(escape, cells))
    results.print(table)
    if made.timing is not None:
        results.print(_times(made.timing, made.labels))
    for each in made.notes:
        results.print(each, markup=False, soft_wrap=True)
    for each in made.findings:
        results.print(each, style="yellow", markup=False, soft_wrap=True)
    results.print(", ".join(map(str, files)), markup=False, soft_wrap=True)
    results.print("definitions of the rows: in the page, or `hoap3 help measuring`", markup=False)


def _times(timing: dict[str, Any], labels: Sequence[str]) -> Table:
    machine = timing["machine"]
    table = Table(box=None, pad_edge=False, title_justify="left", caption_justify="left")
    table.title = "\nTime of an answer in us, different in each run"
    _columns(table, labels)
    steps = [row["step_us"] for row in timing["rows"]]
    for part in ("n", "p50", "p99", "max"):
        cells = [number(step[part]) if part in step else "–" for step in steps]
        table.add_row(f"step, {part}", *cells)
    ratios = [row["times_first"] for row in timing["rows"]]
    table.add_row("step, times the first", *("–" if r is None else number(r) for r in ratios))
    table.caption = f"{machine['processor']}, {machine['cores']} cores, {machine['kernel']}"
    return table


def _columns(table: Table, labels: Sequence[str]) -> None:
    table.add_column("")
    for label in labels:
        table.add_column(escape(label), justify="right")
