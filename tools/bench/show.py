"""Rows of a benchmark as a table for people."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from tools.show import console

COLUMNS = ("min_us", "mean_us", "p50_us", "p99_us", "max_us", "batch_mean_us")


def show_rows(rows: list[dict[str, Any]], machine: dict[str, Any]) -> None:
    """Print a table on standard error, with the machine below it."""
    table = Table(title="us per call, single calls; last column: in batches of ten", box=None)
    for name in ("solver", "n", "samples"):
        table.add_column(name, justify="left" if name == "solver" else "right")
    for name in (*COLUMNS, "times_qp12", "paper_mean_us"):
        table.add_column(name.removesuffix("_us"), justify="right")
    for row in rows:
        paper = row.get("paper") or {}
        table.add_row(
            row["solver"],
            str(row["n"]),
            str(row["samples"]),
            *(f"{row[name]:.2f}" for name in COLUMNS),
            f"{row['times_qp12']:.1f}" if "times_qp12" in row else "",
            f"{paper['mean_us']:.2f}" if paper else "",
        )
    console.print(table)
    console.print(
        f"{machine['processor']}, {machine['cores']} cores, "
        f"{'virtual' if machine['virtual'] else 'bare metal'}, kernel {machine['kernel']}; "
        f"load {machine['load_1min']}. The maximum is the machine's, not the code's.",
        style="dim",
    )
