"""A comparison as tables for people, on standard output."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from hoap3.tools.compare.comparison import Comparison
from hoap3.tools.compare.words import cell, shown_words, unit
from hoap3.tools.html.numbers import number
from hoap3.tools.show.output import results


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


def _times(timing: dict[str, Any], labels: Sequence[str]) -> Table:
    machine = timing["machine"]
    table = Table(box=None, pad_edge=False, title_justify="left", caption_justify="left")
    table.title = "\nTime of an answer in us, different in each run"
    _columns(table, labels)
    for key, what in (("step_us", "step"), ("solve_us", "of it, after kinematics")):
        for part in ("n", "p50", "p99", "max"):
            cells = [number(row[key][part]) if part in row[key] else "–" for row in timing["rows"]]
            table.add_row(f"{what}, {part}", *cells)
    ratios = [row["times_first"] for row in timing["rows"]]
    table.add_row("step, times the first", *("–" if r is None else number(r) for r in ratios))
    table.caption = f"{machine['processor']}, {machine['cores']} cores, {machine['kernel']}"
    return table


def _columns(table: Table, labels: Sequence[str]) -> None:
    table.add_column("")
    for label in labels:
        table.add_column(escape(label), justify="right", overflow="fold")
