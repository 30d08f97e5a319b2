"""The command that changes a controller while it runs: `hoap3 change`."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from hoap3.protocol.errors import UsageError
from hoap3.tools.cli.options import Connect
from hoap3.tools.show.output import print_json

_EXAMPLE = '\'{"order": ["foot", "com", "posture"]}\''


def change(
    request: Annotated[
        str | None,
        typer.Argument(help="JSON object of the controller's own making. Default: only show."),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option("--robot", help="Robot that it controls. Default: the only one that runs."),
    ] = None,
    connect: Connect = None,
) -> None:
    """Change something in a controller that runs; its log has it, and a replay repeats it."""
    from hoap3.tools.cli.find_robot import reach_robot
    from hoap3.tools.services.client import change as ask

    try:
        content = None if request is None else json.loads(request)
    except ValueError as error:
        raise UsageError(f"{request!r:.60} is not JSON ({error})") from error
    if request is not None and not isinstance(content, dict):
        raise UsageError(
            f"{request!r:.60} is no JSON object: write what the controller takes, such as "
            f"{_EXAMPLE} with ghc_velocity"
        )
    name, endpoint = reach_robot(robot, connect)
    print_json(ask(name, content, endpoint))


def priorities() -> None:
    """Say what takes the place of the command of 0.1."""
    raise UsageError(
        "`hoap3 priorities` is now `hoap3 change`: alone it shows them; "
        f'{_EXAMPLE} orders, and "set": [["foot", "posture", 0.5]], "insert": ["foot"], '
        '"remove": ["foot"] and "over_s": 2.0 do the rest: docs/priorities.md'
    )
