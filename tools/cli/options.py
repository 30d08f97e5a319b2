"""What several commands ask of their options."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated

import typer

ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a robot listens by default."""


def reached(connect: str | None, secure: str | None) -> str | None:
    """Where a robot is and with which certificate it is reached; None or empty: what runs here."""
    if secure is None:
        return connect
    from hoap3.protocol.config.endpoints import Place

    return Place(connect or "", secure)


def with_secure(sets: list[str], secure: str | None, *, insecure: bool = False) -> list[str]:
    """The settings of `--set`, and those of `--secure` and `--insecure`."""
    more = [] if secure is None else [f"link.secure={json.dumps(secure)}"]
    return [*sets, *more, *(["link.insecure=true"] if insecure else [])]


def finite(value: float | None) -> float | None:
    """Refuse nan and inf, which pass the comparison with a minimum."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter("is not a finite number")
    return value


LogPath = Annotated[
    Path, typer.Argument(metavar="LOG", help="A log *.mcap, or the folder of a run.")
]
RobotConfig = Annotated[
    str, typer.Option("--robot", help="Robot or emulator config: a name or a path.")
]
Running = Annotated[
    str | None, typer.Argument(help="Name of the robot. Default: the only one that runs.")
]
AllowCode = Annotated[
    bool, typer.Option("--allow-code", help="Import code that the config names by dotted path.")
]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")]
Secure = Annotated[
    str | None,
    typer.Option(
        "--secure",
        metavar="DIR",
        help="Folder of our certificate, as `hoap3 certs issue` makes it: only TLS is spoken.",
    ),
]
Connect = Annotated[
    str | None,
    typer.Option(
        "--connect",
        help=f"Endpoint of a robot or a router. Default: this machine, else {ENDPOINT}.",
    ),
]
RunRobot = Annotated[
    str | None,
    typer.Option(
        help="Robot or emulator config: a name or a path; NAME:=VALUE goes to a xacro file. By "
        "default what the controller's config names."
    ),
]
RunController = Annotated[str, typer.Option(help="Controller config: a name or a path.")]
NoRealtime = Annotated[
    bool, typer.Option("--no-realtime", help="Neither pin nor ask for priority or locked memory.")
]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Show every note.")]
Sets = Annotated[
    list[str],
    typer.Option("--set", metavar="KEY=VALUE", help="Change a setting, checked as a file is."),
]
Tip = Annotated[
    str | None,
    typer.Option("--tip", help="Of a URDF: link that the default task moves, such as tool0."),
]
LockJoints = Annotated[
    list[str],
    typer.Option(
        "--lock-joint",
        metavar="NAME[=VALUE]",
        help="Of a URDF: joint that becomes fixed, by default at 0 or its nearest limit.",
    ),
]
