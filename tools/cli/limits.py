"""The command `hoap3 limits`."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from hoap3.tools.cli.options import AsJson
from hoap3.tools.show.kernel_news import watch_compilation
from hoap3.tools.show.output import print_json, progress


def limits(
    robot: Annotated[str, typer.Argument(help="Robot or emulator config: a name or a path.")],
    samples: Annotated[int, typer.Option(min=1, help="States to try.")] = 1_000_000,
    velocities: Annotated[
        Literal["corners", "uniform"],
        typer.Option(help="Of these states: all at their limits, or uniform."),
    ] = "corners",
    polish: Annotated[
        int, typer.Option(min=0, help="Search around so many of the worst states of each bound.")
    ] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Of the states.")] = 0,
    as_json: AsJson = False,
) -> None:
    """What the torque limits of a robot leave of its joints' accelerations, in the worst state."""
    watch_compilation()
    from hoap3.tools.robots.sampled_limits import sample, show

    with progress(f"states of {robot}") as meter:
        found = sample(robot, samples, velocities, polish, seed, meter.part)
    if as_json:
        print_json(found)
    else:
        show(found)
    raise typer.Exit(1 if found["findings"] else 0)
