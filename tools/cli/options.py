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
    str | None, typer.Argument(help="Name of a running robot. Default: the only one.")
]
AllowCode = Annotated[
    bool, typer.Option("--allow-code", help="Import code that is named as module:Class.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")]
Secure = Annotated[
    str | None,
    typer.Option(
        "--secure",
        metavar="DIR",
        help="Folder with a certificate of `hoap3 certs issue`; only TLS is used then.",
    ),
]
Connect = Annotated[
    str | None,
    typer.Option(
        "--connect",
        help=f"Endpoint of a robot or router. Default: a robot on this machine, else {ENDPOINT}.",
    ),
]
RunRobot = Annotated[
    str | None,
    typer.Option(
        help="Robot or emulator config: a name or a path; NAME:=VALUE sets an argument of a xacro "
        "file. Default: the robot in the controller's config."
    ),
]
RunController = Annotated[str, typer.Option(help="Controller config: a name or a path.")]
NoRealtime = Annotated[
    bool,
    typer.Option("--no-realtime", help="Do not pin to a CPU, raise the priority or lock memory."),
]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Print all messages.")]
Sets = Annotated[
    list[str],
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Override a setting of the config; repeatable."
    ),
]
Tip = Annotated[
    str | None,
    typer.Option("--tip", help="Link of a URDF that the default task moves, such as tool0."),
]
LockJoints = Annotated[
    list[str],
    typer.Option(
        "--lock-joint",
        metavar="NAME[=VALUE]",
        help="Joint of a URDF to lock, by default at 0 or the limit nearest to it; repeatable.",
    ),
]
