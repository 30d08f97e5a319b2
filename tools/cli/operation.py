"""Commands for services that run unattended: `service` and `certs`."""

from __future__ import annotations

from datetime import timedelta
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import typer

from hoap3.tools.analysis.output import print_line, print_note, print_result
from hoap3.tools.cli.options import AsJson, Secure, Sets

service_app = typer.Typer(
    no_args_is_help=True, help="Run emulator and controller as systemd services."
)


class Side(StrEnum):
    """Which service."""

    emulator = "emulator"
    controller = "controller"


@service_app.callback()
def _root() -> None:
    """Run emulator and controller as systemd services."""


@service_app.command()
def install(
    side: Annotated[Side, typer.Argument(help="Service to install.")],
    config: Annotated[
        str, typer.Argument(help="Config of the service, or a robot: a name or a path.")
    ],
    sets: Sets = [],  # noqa: B006 - typer's own way
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the unit; default: that of systemd.")
    ] = None,
    name: Annotated[
        str | None, typer.Option("--name", help="Name of the unit; default: hoap3-SIDE-CONFIG.")
    ] = None,
    user: Annotated[
        str | None,
        typer.Option("--as", help="User of the service; default: one that systemd creates."),
    ] = None,
    of_user: Annotated[
        bool, typer.Option("--user", help="Install for your user, not for the system.")
    ] = False,
    secure: Secure = None,
    as_json: AsJson = False,
) -> None:
    """Write the systemd unit of an emulator or a controller, and print how to start it."""
    from hoap3.tools.services.systemd_unit import install as write

    installed = write(
        *(side.value, config, sets),
        out=out,
        name=name,
        user=user,
        of_user=of_user,
        secure=secure,
    )
    found = {
        "unit": str(installed.path),
        "name": installed.name,
        "command": installed.command,
        "next": list(installed.next),
    }
    print_result(found, str(installed.path), as_json=as_json)
    for command in () if as_json else installed.next:
        print_note(f"next: {command}")


certs_app = typer.Typer(
    no_args_is_help=True, help="Manage certificates of the secure profile, for a laboratory."
)
Folder = Annotated[Path, typer.Option("--dir", help="Folder of the certificate authority.")]
Hosts = Annotated[
    list[str] | None,
    typer.Option("--host", help="Name or address at which a robot is reached; repeatable."),
]
Name = Annotated[
    str, typer.Argument(help="Name in the certificate; for a robot, the robot's name.")
]
Days = Annotated[float, typer.Option(min=0.001, max=36_500.0, help="Validity [days].")]
HERE = Path("certs")


@certs_app.command()
def init(folder: Folder = HERE, days: Days = 3650.0) -> None:
    """Create a certificate authority. Keep its key, ca.key, secret and off the robots."""
    from hoap3.tools.services.certificates import init as make

    print_line(str(make(folder, timedelta(days=days))))


@certs_app.command()
def issue(
    name: Name,
    role: Annotated[
        Literal["robot", "controller", "operator", "observer", "admin"],
        typer.Option(help="Role of the holder."),
    ],
    host: Hosts = None,
    folder: Folder = HERE,
    days: Days = 365.0,
) -> None:
    """Issue a certificate; print the folder for `--secure`.

    Exit code 1: a robot's list is not in the authority's folder, or cannot be read.
    """
    from hoap3.tools.services.certificates import issue as make

    place, changed, failed = make(folder, name, role, host or [], timedelta(days=days))
    print_line(str(place))
    _tell(changed, "a robot that runs takes the new name when it starts again")
    _tell_left(failed, f"Its robot does not let {name!r} in: write the name to its list by hand")


@certs_app.command("list")
def list_all(folder: Folder = HERE, as_json: AsJson = False) -> None:
    """List the certificates with name, role, expiry date and state."""
    from hoap3.tools.services.certificates import read_register

    found = [each.as_json() for each in read_register(folder).certificates]
    lines = [
        f"{each['name']} {each['role']} {each['expires'][:10]} {each['state']}" for each in found
    ]
    print_result({"certificates": found}, lines or "none", as_json=as_json)


@certs_app.command()
def renew(name: Name, host: Hosts = None, folder: Folder = HERE, days: Days = 365.0) -> None:
    """Issue a new key and certificate for a name, with its role, and its hosts or others."""
    from hoap3.tools.services.certificates import renew as make

    print_line(str(make(folder, name, timedelta(days=days), host or [])))
    print_note("copy it to its machine; a session that is open keeps the old one until it ends")


@certs_app.command()
def revoke(name: Name, folder: Folder = HERE) -> None:
    """Remove a name from the lists of all robots for good; exit code 1 if one is left."""
    from hoap3.tools.services.certificates import revoke as take

    changed, failed = take(folder, name)
    print_line(f"{name}: revoked")
    _tell(changed, "")
    _tell_left(failed, f"Its robot lets {name!r} in still: take the name from its list by hand")


def _tell(changed: list[Path], more: str) -> None:
    """Name the lists that have to go to their robots."""
    for file in changed:
        print_note(f"changed {file}: copy it to its robot")
    if changed and more:
        print_note(more)


def _tell_left(failed: list[str], remedy: str) -> None:
    """Name the lists that could not be changed, and end with exit code 1 if there are any."""
    for why in failed:
        print_note(f"{why}. {remedy}")
    if failed:
        raise typer.Exit(1)
