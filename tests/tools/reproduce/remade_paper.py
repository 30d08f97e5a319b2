"""What tests of every paper look for: rows that fail, one row by its words, the whole command."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import typer
from typer.testing import CliRunner

from hoap3.tools.cli.measurements import reproduce
from hoap3.tools.reproduce.rows import Row


def failed(rows: Iterable[Row]) -> list[str]:
    return [row.item for row in rows if row.passed is False]


def of(rows: Iterable[Row], *words: str) -> Row:
    """The only row with all these words."""
    (found,) = [row for row in rows if all(word in row.item for word in words)]
    return found


def assert_all_pass(rows: Sequence[Row]) -> None:
    """Each row has its own name, and passes."""
    assert [row.item for row in rows if row.passed is not True] == []
    assert len(rows) == len({row.item for row in rows})


def remade(paper: str, folder: Path, pictures: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Run the whole command, whose rows pass and which draws these; its rows by their names."""
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command()(reproduce)
    done = CliRunner().invoke(app, [paper, "--out", str(folder), "--json"])
    rows = json.loads(done.stdout)["rows"]
    assert [row["item"] for row in rows if row["pass"] is False] == []
    assert done.exit_code == 0
    names = {path.name for path in folder.iterdir()}
    assert {f"{name}.{kind}" for name in pictures for kind in ("png", "svg")} <= names
    by_item = {row["item"]: row for row in rows}
    assert len(rows) == len(by_item)
    return by_item
