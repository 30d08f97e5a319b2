"""The commands `hoap3 trajectory`: look at a motion before it runs, and take one from a log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from hoap3.protocol.errors import ConfigError
from hoap3.tools.cli.options import AsJson, finite
from hoap3.tools.show.output import print_json, print_line

trajectory_app = typer.Typer(
    no_args_is_help=True, help="Look at a motion before it runs; take one from a log."
)


@trajectory_app.command("check")
def check(
    file: Annotated[str, typer.Argument(metavar="FILE", help="CSV, log, or folder of a run.")],
    robot: Annotated[
        str, typer.Option("--robot", help="Robot or emulator config: a name or a path.")
    ],
    interpolation: Annotated[
        Literal["linear", "cubic", "quintic"] | None,
        typer.Option(help="Default: by what the points carry."),
    ] = None,
    time_scaling: Annotated[
        float, typer.Option(min=1e-6, callback=finite, help="Times are multiplied by it.")
    ] = 1.0,
    approach: Annotated[
        float,
        typer.Option(min=0.0, callback=finite, help="To the first point, where its time is 0 [s]."),
    ] = 1.0,
    as_json: AsJson = False,
) -> None:
    """Say where a motion exceeds limits of a robot's joints, and how much slower it would fit."""
    from hoap3.tools.robots.trajectory_check import look, shown

    found = look(file, robot, interpolation, time_scaling, approach)
    if as_json:
        print_json(found)
    else:
        for line in shown(found):
            print_line(line)
    raise typer.Exit(1 if found["exceeded"] else 0)


@trajectory_app.command("from")
def from_(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="*.mcap, or the folder of a run.")],
    out: Annotated[Path, typer.Option("--out", help="CSV file to write.")],
    played: Annotated[
        Literal["measured", "applied"],
        typer.Option(help="The joints as they were, or the robot's reference."),
    ] = "measured",
    every: Annotated[
        float, typer.Option(min=1e-6, callback=finite, help="Time between the points [s].")
    ] = 0.01,
) -> None:
    """Write the motion of a log as the CSV of a trajectory."""
    from hoap3.tools.logs.atomic_write import whole_file
    from hoap3.tools.logs.motions import motion_of

    text = motion_of(log, played, every)
    try:
        with whole_file(out) as draft:
            draft.write_text(text, encoding="utf-8")
    except OSError as error:
        remedy = "Name a file in a folder that can be written"
        reason = error.strerror or "cannot be written"
        raise ConfigError("--out", "", str(out), reason, remedy) from error
    print_line(f"{out}: {text.count(chr(10)) - 1} points")
