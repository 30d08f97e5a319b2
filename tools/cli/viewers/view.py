"""The command `hoap3 view`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hoap3.tools.cli.options import Connect, Secure, reached
from hoap3.tools.show.output import print_line, print_note


def view(
    what: Annotated[
        str | None,
        typer.Argument(
            metavar="[ROBOT|LOG]",
            help="Name of a running robot, or a log or the folder of a run. Default: the only "
            "robot that runs.",
        ),
    ] = None,
    second: Annotated[
        Path | None, typer.Argument(metavar="[LOG]", help="A second log, drawn as a ghost.")
    ] = None,
    connect: Connect = None,
    secure: Secure = None,
    host: Annotated[
        str, typer.Option("--host", help="Address to listen at; others than loopback are seen.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Port to listen at; 0: any free one.")
    ] = 8080,
    robot: Annotated[
        str | None,
        typer.Option("--robot", help="The robot's folder on this machine, for its meshes."),
    ] = None,
    no_steering: Annotated[
        bool, typer.Option("--no-steering", help="Show only: nobody may stop, change or steer.")
    ] = False,
) -> None:
    """Show a running robot, or a log, in a browser; print the address of the page."""
    from hoap3.tools.machine.extras import check_view

    check_view()
    from hoap3.tools.view.serve import serve_log, serve_robot, warn_of

    logs = [Path(what)] if what is not None and is_log(what) else []
    note = warn_of(host)
    if note:
        print_note(note)
    if logs:
        serve_log([*logs, *([second] if second else [])], host, port, robot, print_line)
        return
    if second is not None:
        raise typer.BadParameter("a second log goes with a log, not with a robot")
    from hoap3.tools.services.find_robot import reach_robot

    name, endpoint = reach_robot(what, reached(connect, secure))
    serve_robot(
        *(name, endpoint, host, port, robot, print_line),
        steering=not no_steering,
    )


def is_log(what: str) -> bool:
    """Whether it names a log rather than a robot."""
    path = Path(what)
    return "/" in what or path.suffix == ".mcap" or any(path.glob("*.mcap"))
