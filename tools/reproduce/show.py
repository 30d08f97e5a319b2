"""A reproduction as a table for people."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from hoap3.tools.reproduce.remake import Reproduction
from hoap3.tools.reproduce.rows import Row
from hoap3.tools.show.output import results

_MARKS = {True: "[green]pass[/green]", False: "[red]FAIL[/red]", None: "[dim]–[/dim]"}


def show_rows(made: Reproduction) -> None:
    """Print rows, their reasons as notes, and a summary on standard output."""
    reasons = list(dict.fromkeys(row.why for row in made.rows))
    table = Table(box=None, pad_edge=False)
    for name in ("item", "paper", "ours", "expected", "", "note"):
        table.add_column(name, justify="left" if name in {"item", ""} else "right")
    for row in made.rows:
        ours = f"{row.ours:.4g} {row.unit}".strip()
        said = (row.item, _said(row.paper), ours, _expected(row))
        note = str(1 + reasons.index(row.why))
        table.add_row(*map(escape, said), _MARKS[row.passed], note)
    results.print(table)
    for number, reason in enumerate(reasons, 1):
        results.print(f"{number:3}  {reason}", style="dim", markup=False, soft_wrap=True)
    judged = [row for row in made.rows if row.passed is not None]
    failed = [row for row in judged if not row.passed]
    machine = made.machine
    results.print(
        f"{len(judged) - len(failed)} of {len(judged)} rows pass; the other "
        f"{len(made.rows) - len(judged)} are measurements, on {machine['processor']}, "
        f"{machine['cores']} cores, kernel {machine['kernel']}, load {machine['load_1min']}.",
        style="bold red" if failed else "bold",
    )
    results.print(
        f"{len(made.files)} files in {made.files[-1].parent}", markup=False, soft_wrap=True
    )


def _said(paper: float | str | None) -> str:
    return "" if paper is None else paper if isinstance(paper, str) else f"{paper:.4g}"


def _expected(row: Row) -> str:
    """The reference, or else the bounds."""
    if isinstance(row.reference, int | float):
        return f"{row.reference:g}"
    low, high = row.reference or row.tolerance or (None, None)
    if low is None:
        return "" if high is None else f"at most {high:.3g}"
    if high is None:
        return f"at least {low:g}"
    return f"{low:g} to {high:g}" if low < high else f"{low:g}"
