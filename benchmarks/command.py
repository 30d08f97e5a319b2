"""What the command lines of all benchmarks here share."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from hoap3.protocol.errors import Hoap3Error
from hoap3.tools.analysis.output import results
from hoap3.tools.machine.processes import to_people

Calls = Annotated[
    int, typer.Option(min=10, help="Calls of each peer; ours is called 20 times as often.")
]
Quick = Annotated[bool, typer.Option("--quick", help="10 samples of few cases: a trial run.")]
Plot = Annotated[Path | None, typer.Option(help="Draw the times into this PNG, SVG or PDF.")]


def main(command: Callable[..., Any]) -> None:
    """Run a function, or a typer app, as a command line; print an error of ours in one line."""
    try:
        command() if isinstance(command, typer.Typer) else typer.run(command)
    except Hoap3Error as error:
        to_people(f"error: {error}")
        sys.exit(1)


def show_missing(missing: dict[str, str]) -> None:
    """Print which solvers are not installed, and their packages."""
    for name, package in missing.items():
        results.print(f"Not installed: {name} (pip install {package}).", style="dim")


def show_ratio(what: str, times: float, least: float) -> None:
    """Print how many times as long as ours something takes."""
    results.print(
        f"{what} takes {times:.0f} times as long, of the shortest calls {least:.0f} times."
    )
