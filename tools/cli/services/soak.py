"""The command `hoap3 soak`: whether the services run unattended for hours."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hoap3.protocol.errors import UsageError
from hoap3.remote_controller.pairs import DEFAULT_CONFIG
from hoap3.tools.cli.options import (
    AsJson,
    NoRealtime,
    RunController,
    RunRobot,
    Sets,
    Verbose,
    finite,
)
from hoap3.tools.machine.processes import StopFlag
from hoap3.tools.show.kernel_news import watch_compilation
from hoap3.tools.show.output import print_json, print_note

MINUTES = 90.0
WARM_UP, WARM_UP_MIN = 1 / 9, 10.0  # of the whole, and at most


def soak(
    hours: Annotated[
        float | None, typer.Option(min=0.001, callback=finite, help="How long [h].")
    ] = None,
    minutes: Annotated[
        float | None,
        typer.Option(min=0.05, callback=finite, help=f"How long [min]; default: {MINUTES:g}."),
    ] = None,
    warm_up_minutes: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            callback=finite,
            help="Of them at the begin, which are not measured [min]; default: 1/9, at most 10.",
        ),
    ] = None,
    robot: RunRobot = None,
    controller: RunController = DEFAULT_CONFIG,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for logs and results; default: a new one in logs/."),
    ] = None,
    as_json: AsJson = False,
    no_realtime: NoRealtime = False,
    verbose: Verbose = False,
    sets: Sets = [],  # noqa: B006 - typer's own way
) -> None:
    """Run robot and controller for hours; judge memory, descriptors, threads, phase, deadlines."""
    stop = StopFlag()
    from hoap3.tools.machine.extras import check_drawing, check_metrics

    check_drawing()
    check_metrics()
    watch_compilation()
    from hoap3.tools.services.services import controller_config, emulator_config, split_overrides
    from hoap3.tools.show.summary import LiveTable
    from hoap3.tools.soak.show import show_soak
    from hoap3.tools.soak.soak import ROTATED, with_metrics
    from hoap3.tools.soak.soak import soak as run_soak
    from hoap3.tools.soak.watch import Plan

    whole = _minutes(hours, minutes)
    warm_up = min(WARM_UP * whole, WARM_UP_MIN) if warm_up_minutes is None else warm_up_minutes
    plan = Plan(60 * whole, 60 * warm_up)
    realtime = not no_realtime
    ours, theirs = split_overrides(sets)
    theirs = [with_metrics(), *theirs]
    law, law_file = controller_config(controller, theirs, realtime=realtime)
    ours = [*ROTATED, with_metrics(), *ours]
    emulator, file = emulator_config(robot or law.robot, ours, realtime=realtime)
    title = f"soak of {Path(emulator.robot).name} with {controller}, {whole:g} min"
    with LiveTable(title, verbose=verbose) as table:
        soaked = run_soak(
            *(emulator, law, plan, out, table.news, print_note, (file, law_file)),
            should_stop=stop,
        )
    if as_json:
        print_json(soaked)
    else:
        show_soak(soaked)
    raise typer.Exit(0 if soaked["verdict"] == "pass" else 1)


def _minutes(hours: float | None, minutes: float | None) -> float:
    """How long it takes, by the one option that says so."""
    if hours is not None and minutes is not None:
        raise UsageError("--hours and --minutes: give one of them")
    if hours is not None:
        return 60 * hours
    return MINUTES if minutes is None else minutes
