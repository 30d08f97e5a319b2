"""A reproduction as a table for people."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from hoap3.tools.analysis.output import results
from hoap3.tools.reproduce.remake import Reproduction
from hoap3.tools.reproduce.rows import CONFIRMED, MEASURED, NOT_REPRODUCED, REPRODUCED, Row

_MARKS = {
    REPRODUCED: "[green]reproduced[/green]",
    NOT_REPRODUCED: "[yellow]not reproduced[/yellow]",
    CONFIRMED: "[green]confirmed[/green]",
    MEASURED: "[dim]measured[/dim]",
}


def show_rows(made: Reproduction) -> None:
    """Print rows, their reasons as notes, and the counts of each class on standard output."""
    reasons = list(dict.fromkeys(row.note for row in made.rows))
    table = Table(box=None, pad_edge=False)
    for name in ("item", "paper", "ours", "expected", "class", "note"):
        table.add_column(name, justify="left" if name in {"item", "class"} else "right")
    for row in made.rows:
        ours = f"{row.ours:.4g} {row.unit}".strip()
        cells = (row.item, _printed(row.paper), ours, _expected(row))
        note = str(1 + reasons.index(row.note))
        mark = "[red]FAIL[/red]" if row.passed is False else _MARKS[row.kind]
        table.add_row(*map(escape, cells), mark + (", fitted" if row.fitted else ""), note)
    results.print(table)
    for number, reason in enumerate(reasons, 1):
        results.print(f"{number:3}  {reason}", style="dim", markup=False, soft_wrap=True)
    counts, machine = made.counts, made.machine
    claims = [row for row in made.rows if row.kind == CONFIRMED]
    results.print(
        f"printed numbers: {counts[REPRODUCED]} reproduced "
        f"({counts['of these reproduced with fitted inputs']} with fitted inputs), "
        f"{counts[NOT_REPRODUCED]} not reproduced; claims and equations: "
        f"{sum(row.passed is True for row in claims)} of {len(claims)} confirmed; "
        f"measured only: {counts[MEASURED]}; failed rows: {counts['failed']}. "
        f"On {machine['processor']}, {machine['cores']} cores, kernel {machine['kernel']}, "
        f"load {machine['load_1min']}.",
        style="bold" if made.passed else "bold red",
    )
    results.print(
        f"{len(made.files)} files in {made.files[-1].parent}", markup=False, soft_wrap=True
    )


def _printed(paper: float | str | None) -> str:
    return "" if paper is None else paper if isinstance(paper, str) else f"{paper:.4g}"


def _expected(row: Row) -> str:
    """The reference, or else the bounds."""
    if row.reference is not None:
        return f"{row.reference:.4g}"
    low, high = row.tolerance or (None, None)
    if low is None:
        return "" if high is None else f"at most {high:.3g}"
    if high is None:
        return f"at least {low:g}"
    return f"{low:g} to {high:g}" if low < high else f"{low:g}"
