"""What pushes were survived, as a table for people."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from hoap3.tools.show.output import results

NUMBERS = {
    "room_m": ".4f",
    "bound_ns": ".2f",
    "torque_bound_ns": ".2f",
    "survived_ns": ".2f",
    "share": ".0%",
    "wanted": ".0%",
}


def show_pushes(rows: list[dict[str, Any]]) -> None:
    """Print a row for each robot, controller and direction on standard output."""
    table = Table(title="pushes of 20 ms at the trunk, impulses in N s", box=None)
    for name in ("robot", "controller", "direction_deg", *NUMBERS):
        table.add_column(name, justify="left" if name in {"robot", "controller"} else "right")
    for row in rows:
        figures = [format(row[name], form) for name, form in NUMBERS.items()]
        table.add_row(row["robot"], row["controller"], str(row["direction_deg"]), *figures)
    results.print(table)
    missed = sum(row["share"] < row["wanted"] for row in rows)
    results.print(f"{len(rows) - missed} of {len(rows)} survive the share that is wanted of them.")
