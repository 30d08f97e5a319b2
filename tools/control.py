"""`hoap3 stop`, `recover`, `status`, `change` and `list --live`: words with what runs."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
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


def change(robot: str, request: Mapping[str, Any] | None, endpoint: str) -> dict[str, Any]:
    """Have the controller of a running robot change something.

    Args:
        robot: its name.
        request: what shall be otherwise; None: only ask.
        endpoint: where the robot, or a router, listens.

    Returns:
        What can be changed, as it is now.

    Raises:
        UsageError: that cannot be the name of a robot, or the controller refuses.
        LinkError: the robot cannot be reached, or follows no controller.
    """
    from protocol.zenoh_link import ask, open_session  # noqa: PLC0415

    check_name(robot)
    verb, body = ("show", "") if request is None else ("change", json.dumps(request))
    with open_session(LinkSettings(connect=(endpoint,), mode="client")) as session:
        reply = ask(session, robot, verb, body, whom="control")
    if reply is None:
        raise LinkError(
            f"no controller of a robot called {robot!r} answers at {endpoint}: `hoap3 status` says "
            "whom it follows. In lockstep a controller answers only while its robot moves"
        )
    answer: dict[str, Any] = json.loads(reply)
    if answer["error"] is not None:
        raise UsageError(str(answer["error"]))
    present: dict[str, Any] = answer["now"]
    return present


def check_name(robot: str) -> None:
    """Refuse what is no name of one robot, such as a wildcard."""
    if not re.fullmatch(NAME_PATTERN, robot):
        raise UsageError(f"{robot!r} is not the name of a robot. Names match {NAME_PATTERN}")


def alive(endpoint: str) -> list[str]:
    """Names of the robots that are alive behind an endpoint."""
    from protocol.zenoh_link import alive_robots, open_session  # noqa: PLC0415

    with open_session(LinkSettings(connect=(endpoint,), mode="client")) as session:
        return alive_robots(session)
