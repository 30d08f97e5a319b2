"""The commands `hoap3 service`: emulator and controller as services of systemd."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from hoap3.tools.cli.options import AsJson, Secure, finite
from hoap3.tools.show.output import print_json, print_line, print_note

service_app = typer.Typer(no_args_is_help=True, help="Run emulator and controller by systemd.")


class Side(StrEnum):
    """Which service."""

    emulator = "emulator"
    controller = "controller"


@service_app.callback()
def _root() -> None:
    """Run emulator and controller by systemd."""


@service_app.command()
def install(
    side: Annotated[Side, typer.Argument(help="Which service.")],
    config: Annotated[str, typer.Argument(help="Its config, or robot: a name or a path.")],
    sets: Annotated[
        list[str],
        typer.Option("--set", metavar="KEY=VALUE", help="Change a setting, checked as a file is."),
    ] = [],  # noqa: B006 - typer's own way
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the unit; default: systemd's own.")
    ] = None,
    name: Annotated[
        str | None, typer.Option("--name", help="Of the unit; default: hoap3-SIDE-CONFIG.")
    ] = None,
    user: Annotated[
        str | None,
        typer.Option("--as", help="User that it runs as; default: one that systemd makes for it."),
    ] = None,
    of_user: Annotated[
        bool, typer.Option("--user", help="For your own systemd rather than the system's.")
    ] = False,
    watchdog: Annotated[
        float | None,
        typer.Option(
            callback=finite,
            help="Seconds without a sign of life of its loop after which it is restarted; "
            "default: 10 of an emulator, 30 of a controller.",
        ),
    ] = None,
    secure: Secure = None,
    as_json: AsJson = False,
) -> None:
    """Write the systemd unit of an emulator or a controller, and say how to start it."""
    from hoap3.tools.services.units.install import install as write

    installed = write(
        *(side.value, config, sets),
        out=out,
        name=name,
        user=user,
        of_user=of_user,
        watchdog_s=watchdog,
        secure=secure,
    )
    if as_json:
        print_json(
            {
                "unit": str(installed.path),
                "name": installed.unit.name,
                "command": list(installed.unit.command),
                "next": list(installed.next),
            }
        )
        return
    print_line(str(installed.path))
    for command in installed.next:
        print_note(f"next: {command}")
