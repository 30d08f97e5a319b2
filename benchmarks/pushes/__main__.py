"""The command line: `python -m benchmarks.pushes`."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.table import Table

from benchmarks.command import main
from benchmarks.pushes.trials import DIRECTIONS_DEG, LEAST, TRUNKS, bench_pushes
from hoap3.tools.analysis.output import progress, results
from hoap3.tools.bench.case_runner import run_benchmark
from hoap3.tools.cli.options import AsJson

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


def command(
    robot: Annotated[
        list[str] | None, typer.Option(help="Emulator configs; by default all, one by one.")
    ] = None,
    controller: Annotated[
        list[str] | None, typer.Option(help="Configs; by default all there are.")
    ] = None,
    direction: Annotated[
        list[int] | None, typer.Option(help="Of the push, from x [deg]; by default all eight.")
    ] = None,
    least: Annotated[
        float, typer.Option(min=0.1, max=1.4, help="Share of the bound that is tried first.")
    ] = LEAST,
    as_json: AsJson = False,
) -> None:
    """Push standing robots in MuJoCo, and compare what they survive with what is possible."""
    directions = direction or DIRECTIONS_DEG
    measured = run_benchmark(
        progress("pushes"),
        lambda meter: {
            "rows": bench_pushes(
                robot or tuple(TRUNKS), controller or (), directions, meter.step, least
            )
        },
        lambda measured: show_pushes(measured["rows"]),
        as_json=as_json,
    )
    raise typer.Exit(any(row["share"] < row["wanted"] for row in measured["rows"]))


if __name__ == "__main__":
    main(command)
