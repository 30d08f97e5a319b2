"""Finds a paper, has it re-made, and puts everything into a folder."""

from __future__ import annotations

import csv
import importlib
import json
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hoap3.protocol.errors import UnknownNameError
from hoap3.tools.analysis.result_folder import make_folder, new_name, unwritable
from hoap3.tools.machine.machine import machine_block
from hoap3.tools.reproduce import papers as shelf
from hoap3.tools.reproduce.figures import Figure, save
from hoap3.tools.reproduce.rows import Row, count

RESULT = "rows.json"


@dataclass(frozen=True)
class Reproduction:
    """A paper that was re-made.

    Attributes:
        rows: what was checked.
        machine: on what.
        files: figures, their data, and the rows.
    """

    rows: list[Row]
    machine: dict[str, object]
    files: list[Path]

    @property
    def passed(self) -> bool:
        """Whether no row fails."""
        return all(row.passed is not False for row in self.rows)

    @property
    def counts(self) -> dict[str, int]:
        """Rows of each class, and how many fail."""
        return count(self.rows)

    def as_json(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "counts": self.counts,
            "rows": [row.as_json() for row in self.rows],
            "machine": self.machine,
            "files": [str(path) for path in self.files],
        }


def papers() -> list[str]:
    """Names of the papers that can be re-made."""
    return sorted(module.name for module in pkgutil.iter_modules(shelf.__path__))


def reproduce(
    paper: str, out: Path | None = None, say: Callable[[str], None] = lambda _: None
) -> Reproduction:
    """Re-make a paper.

    Args:
        paper: one of `papers()`.
        out: folder for the files, made where there is none; default: a new one in
            `reproduced/<paper>`.
        say: takes what is being done, for people.

    Raises:
        UnknownNameError: no such paper; carries the nearest name.
        ConfigError: the folder cannot be written, or holds a reproduction already.
    """
    if paper not in papers():
        raise UnknownNameError("paper", paper, papers())
    folder = out or new_name(Path("reproduced") / paper)
    make_folder(folder, RESULT)
    figures: list[Figure]
    rows: list[Row]
    figures, rows = importlib.import_module(f"{shelf.__name__}.{paper}").remake(say)
    files = []
    try:
        for figure in figures:
            say(f"drawing {figure.name}")
            files += save(figure, folder)
        files.append(_write_rows(rows, folder / "rows.csv"))
        made = Reproduction(rows, machine_block(), [*files, folder / RESULT])
        text = json.dumps(made.as_json(), indent=2) + "\n"
        (folder / RESULT).write_text(text, encoding="utf-8")
    except OSError as error:
        raise unwritable(folder, error) from error
    return made


def _write_rows(rows: list[Row], path: Path) -> Path:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, [*rows[0].as_json()])
        writer.writeheader()
        writer.writerows(row.as_json() for row in rows)
    return path
