"""The command that changes a controller while it runs: `hoap3 change`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Annotated, Any

import typer

from hoap3.protocol.errors import UsageError
from hoap3.tools.cli.options import Connect, Secure, reached
from hoap3.tools.show.output import print_json

_EXAMPLE = '\'{"order": ["foot", "com", "posture"]}\''


def change(
    request: Annotated[
        list[str] | None,
        typer.Argument(
            help="KEY=VALUE of numbers that may change, such as gamma=0.8 over_s=1; or one JSON "
            "object. Default: only show."
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option("--robot", help="Robot that it controls. Default: the only one that runs."),
    ] = None,
    connect: Connect = None,
    secure: Secure = None,
) -> None:
    """Change something in a controller that runs; its log has it, and a replay repeats it."""
    from hoap3.tools.services.client import change as ask
    from hoap3.tools.services.find_robot import reach_robot

    content = _content(request or [])
    name, endpoint = reach_robot(robot, reached(connect, secure))
    print_json(ask(name, content, endpoint))


def _content(given: Sequence[str]) -> dict[str, Any] | None:
    """What shall be otherwise; None where nothing is given.

    Raises:
        UsageError: neither a JSON object nor KEY=VALUE.
    """
    if not given:
        return None
    if len(given) > 1 or given[0].lstrip()[:1] not in {"{", "["}:
        return _pairs(given)
    try:
        content = json.loads(given[0])
    except ValueError as error:
        raise UsageError(f"{given[0]!r:.60} is not JSON ({error})") from error
    if not isinstance(content, dict):
        raise UsageError(
            f"{given[0]!r:.60} is no JSON object: write what the controller takes, such as "
            f"gamma=0.8 with qp12, or {_EXAMPLE} with ghc_velocity"
        )
    return content


def _pairs(given: Sequence[str]) -> dict[str, Any]:
    from hoap3.protocol.config.settings import apply_overrides

    content: dict[str, Any] = {}
    for pair in given:
        key, equals, _ = pair.partition("=")
        if not equals or not key.strip():
            raise UsageError(
                f"{pair!r:.60} is not KEY=VALUE, such as gamma=0.8: write so, or one JSON object"
            )
        content = apply_overrides(content, [pair])
    return content


def priorities() -> None:
    """Say what takes the place of the command of 0.1."""
    raise UsageError(
        "`hoap3 priorities` is now `hoap3 change`: alone it shows them; "
        f'{_EXAMPLE} orders, and "set": [["foot", "posture", 0.5]], "insert": ["foot"], '
        '"remove": ["foot"] and "over_s": 2.0 do the rest: `hoap3 help priorities`'
    )
