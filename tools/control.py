"""`hoap3 stop`, `recover`, `status` and `list --live`: words with a robot that runs."""

from __future__ import annotations

import json
import os
import re
from typing import Any

from protocol.errors import LinkError, UsageError
from protocol.settings import NAME_PATTERN, LinkSettings


def tell(robot: str, verb: str, endpoint: str) -> dict[str, Any]:
    """Ask a running robot something.

    Args:
        robot: its name.
        verb: "stop", "recover" or "status".
        endpoint: where it, or a router, listens.

    Raises:
        UsageError: that cannot be the name of a robot.
        LinkError: it cannot be reached.
    """
    from protocol.zenoh_link import ask, open_session  # noqa: PLC0415

    check_name(robot)
    with open_session(LinkSettings(connect=(endpoint,), mode="client")) as session:
        reply = ask(session, robot, verb, f"tool-{os.getpid()}")
    if reply is None:
        raise LinkError(f"no robot called {robot!r} answers at {endpoint}: `hoap3 list --live`")
    answer: dict[str, Any] = json.loads(reply)
    return answer


def check_name(robot: str) -> None:
    """Refuse what is no name of one robot, such as a wildcard."""
    if not re.fullmatch(NAME_PATTERN, robot):
        raise UsageError(f"{robot!r} is not the name of a robot. Names match {NAME_PATTERN}")


def alive(endpoint: str) -> list[str]:
    """Names of the robots that are alive behind an endpoint."""
    from protocol.zenoh_link import alive_robots, open_session  # noqa: PLC0415

    with open_session(LinkSettings(connect=(endpoint,), mode="client")) as session:
        return alive_robots(session)
