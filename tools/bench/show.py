"""What a benchmark measured, as tables for people."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rich.table import Table

from hoap3.tools.analysis.output import results

Row = dict[str, Any]

COLUMNS = ("min_us", "mean_us", "p50_us", "p99_us", "max_us", "batch_mean_us")
FEWER = ("min_us", "p50_us", "p99_us")
SINGLE = "us per call, single calls; "
LEFT = {"solver", "robot", "case", "paths"}
"""Columns of words; all others are numbers."""


def show_rows(measured: Row) -> None:
    """Print a row a solver on standard output, with the machine below it."""
    rows = measured["rows"]
    (times,) = rows[0].keys() & {"times_qp12", "times_reference"}

    def cells(row: Row) -> dict[str, str]:
        paper = (row.get("paper") or {}).get("mean_us")
        return {
            **words(row, "solver", "n", "samples"),
            **numbers(row, ".2f", *COLUMNS, times),
            "paper_mean": number(paper, ".2f"),
            "worst_error": number(row.get("worst_error"), ".0e"),
        }

    show_table(f"{SINGLE}batch_mean: median of batches of ten", rows, cells, measured["machine"])


def show_table(
    title: str, rows: list[Any], cells: Callable[[Any], dict[str, str]], machine: Row
) -> None:
    """Print a table with the machine below it.

    Args:
        title: above it.
        rows: what it shows.
        cells: gives what a row has in each column, by the column's name.
        machine: the machine block.
    """
    table = Table(title=title, box=None)
    for name in cells(rows[0]):
        table.add_column(name, justify="left" if name in LEFT else "right")
    for row in rows:
        table.add_row(*cells(row).values())
    results.print(table)
    results.print(
        f"{machine['processor']}, {machine['cores']} cores, "
        f"{'virtual' if machine['virtual'] else 'bare metal'}, kernel {machine['kernel']}; "
        f"load {machine['load_1min']}. The maximum is the machine's, not the code's.",
        style="dim",
    )


def words(row: Row, *names: str) -> dict[str, str]:
    """Cells that are words, empty where there is none."""
    return {name: str(row[name] or "") for name in names}


def numbers(row: Row, form: str, *names: str) -> dict[str, str]:
    """Cells that are numbers, without the unit in their names."""
    return {name.removesuffix("_us"): number(row[name], form) for name in names}


def number(value: float | None, form: str) -> str:
    """A number, empty where there is none."""
    return "" if value is None else format(value, form)
