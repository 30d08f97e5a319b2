"""The command `hoap3 latency`: what the link costs, and whose fault a miss was."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from hoap3.tools.cli.options import AsJson
from hoap3.tools.machine.processes import StopFlag
from hoap3.tools.show.output import print_json, progress


def latency(
    log: Annotated[
        Path | None, typer.Option(help="Measure nothing: analyse the log of a run.")
    ] = None,
    link: Annotated[
        Literal["tcp", "udp", "unixsock", "tls", "hoap3_tcp"],
        typer.Option(help="What to measure; tls: with certificates, in turns with tcp."),
    ] = "tcp",
    robot: Annotated[
        str, typer.Option(help="Robot or emulator config: a name or a path.")
    ] = "hoap3",
    blocks: Annotated[int, typer.Option(min=1, help="Blocks of each, Zenoh and echo.")] = 5,
    ticks: Annotated[int, typer.Option(min=100, help="Ticks of a block.")] = 2000,
    out: Annotated[
        Path | None, typer.Option(help="New folder for the logs; default: they are not kept.")
    ] = None,
    no_realtime: Annotated[
        bool, typer.Option("--no-realtime", help="Neither pin nor ask for priority.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Measure the link with a controller that computes nothing, beside a bare TCP echo."""
    stop = StopFlag()
    from hoap3.tools.latency.latency import Plan, analyse_log, measure_latency
    from hoap3.tools.latency.show import show_latency
    from hoap3.tools.services.services import emulator_config
    from hoap3.tools.show.verdicts import failed

    if log is not None:
        found = analyse_log(log)
    else:
        emulator, _ = emulator_config(robot, [], realtime=not no_realtime)
        plan = Plan(emulator, link, blocks, ticks, realtime=not no_realtime, out=out)
        with progress("latency") as meter:
            found = measure_latency(plan, meter.step, stop)
    if as_json:
        print_json(found)
    else:
        show_latency(found)
    raise typer.Exit(1 if failed(found["verdicts"]) else 0)
