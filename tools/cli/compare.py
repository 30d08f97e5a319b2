"""The command `hoap3 compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hoap3.tools.cli.options import AsJson, finite
from hoap3.tools.show.kernel_news import watch_compilation
from hoap3.tools.show.output import print_json, progress


def compare(
    controllers: Annotated[
        list[str],
        typer.Argument(
            metavar="[LABEL=]CONTROLLER[@KEY=VALUE,…]",
            help="At least two: what `run --controller` takes, with changed parameters.",
        ),
    ],
    log: Annotated[
        Path | None,
        typer.Option("--log", metavar="LOG", help="Answer its States, and move nothing."),
    ] = None,
    robot: Annotated[
        str | None, typer.Option(help="Robot or emulator config; default: hoap3.")
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(min=0.001, callback=finite, help="Of the motion [s]; default: 20."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Of everything random; default: 0.")
    ] = None,
    timing: Annotated[
        bool, typer.Option("--timing/--no-timing", help="Also measure how long answers take.")
    ] = True,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for the files; default: a new one in compared/."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Set controllers beside each other: on a robot each in lockstep, or on the States of a log."""
    from hoap3.tools.machine.extras import check_drawing

    check_drawing()
    watch_compilation()
    from hoap3.tools.compare.comparison import compare as make
    from hoap3.tools.compare.show import show
    from hoap3.tools.compare.write import RESULT, write
    from hoap3.tools.show.result_folder import make_folder, new_name

    folder = out or new_name(Path("compared"))
    with progress("compare") as meter:
        made = make(
            controllers,
            robot,
            duration,
            seed,
            log,
            timing=timing,
            say=meter.step,
            ready=lambda: make_folder(folder, RESULT),
        )
        files = write(made, folder)
    if as_json:
        names = [str(path) for path in files]
        print_json({**made.as_json(), "timing": made.timing, "files": names})
    else:
        show(made, files)
    raise typer.Exit(1 if made.findings else 0)
