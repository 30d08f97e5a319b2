"""The command line: `python -m benchmarks.load clients`, `view` or `flood`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.command import main
from benchmarks.load.runs import CLIENTS, FLOOD, PAGE, race
from benchmarks.load.show import show_race
from hoap3.tools.analysis.output import progress
from hoap3.tools.bench.case_runner import run_benchmark
from hoap3.tools.cli.options import AsJson, NoRealtime
from hoap3.tools.machine.machine import check_extra

CHECKOUT = Path(__file__).resolve().parents[2]

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, add_completion=False)
Pairs = Annotated[int, typer.Option(min=2, help="Runs with it, and as many without.")]
Seconds = Annotated[float, typer.Option(min=1.0, help="Of each run [s].")]


@app.command()
def clients(
    count: Annotated[int, typer.Option(min=1, help="Clients; the first one steers.")] = 20,
    rate: Annotated[
        float, typer.Option(min=1.0, max=1000.0, help="Of what each reads and sends [Hz].")
    ] = 60.0,
    apart: Annotated[
        bool, typer.Option("--apart", help="Both loops on one CPU, clients on the others.")
    ] = False,
    pairs: Pairs = 10,
    seconds: Seconds = 60.0,
    as_json: AsJson = False,
    no_realtime: NoRealtime = False,
) -> None:
    """Run UR5 in real time with and without Python clients, in turn."""
    order = {"count": count, "rate_hz": rate}
    _race(CLIENTS, order, (pairs, seconds), as_json, realtime=not no_realtime, apart=apart)


@app.command()
def view(
    browser: Annotated[
        Path | None,
        typer.Option(help="A Chromium that draws the page; else a client that draws nothing."),
    ] = None,
    pairs: Pairs = 10,
    seconds: Seconds = 60.0,
    as_json: AsJson = False,
    no_realtime: NoRealtime = False,
) -> None:
    """Run UR5 in real time with and without the live page, in turn."""
    check_extra("view")
    order = {"browser": None if browser is None else str(browser)}
    _race(PAGE, order, (pairs, seconds), as_json, realtime=not no_realtime)


@app.command()
def flood(
    rate: Annotated[
        float, typer.Option(min=1.0, max=1e6, help="Messages of the intruder [Hz].")
    ] = 20_000.0,
    pairs: Pairs = 10,
    seconds: Seconds = 60.0,
    as_json: AsJson = False,
    no_realtime: NoRealtime = False,
) -> None:
    """Run UR5 in real time with and without an intruder that floods it with messages, in turn."""
    order = {"rate_hz": rate}
    _race(FLOOD, order, (pairs, seconds), as_json, realtime=not no_realtime)


def _race(
    module: str, order: Mapping[str, Any], runs: tuple[int, float], as_json: bool, **placed: bool
) -> None:
    paths = [str(CHECKOUT), os.environ.get("PYTHONPATH", "")]
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, paths))  # of `module`'s process
    run_benchmark(
        progress(module.rpartition(".")[2]),
        lambda meter: race(module, order, *runs, meter.part, **placed),
        show_race,
        as_json=as_json,
    )


if __name__ == "__main__":
    main(app)
