"""Which robot a command means: the one that is named, or else the only one that runs.

Without an endpoint, robots of this user on this machine come first, which need no network.
"""

from __future__ import annotations

from typing import Any

from hoap3.protocol.answers import ROBOT_ANSWERS, check_answer
from hoap3.protocol.config.endpoints import Place
from hoap3.protocol.errors import LinkError, UsageError
from hoap3.protocol.link.local_control import LocalRobot, local_robots, others_here
from hoap3.tools.cli.options import ENDPOINT
from hoap3.tools.services.client import alive, check_name, tell


def ask_robot(robot: str | None, verb: str, endpoint: str | None) -> tuple[str, dict[str, Any]]:
    """Ask a running robot something.

    Args:
        robot: its name; None: the only one that runs.
        verb: "stop", "recover" or "status".
        endpoint: where it, or a router, listens; None: on this machine, else at `ENDPOINT`.

    Returns:
        Its name and its answer.

    Raises:
        UsageError: several robots run, or that cannot be a name, or an endpoint.
        LinkError: none runs, or it does not answer.
        WireError: its answer makes no sense.
    """
    found = find_local(robot) if endpoint is None else None
    if found is not None:
        return found.name, _answer(found, verb)
    place = ENDPOINT if endpoint is None else endpoint
    name = robot or only_alive(place)
    try:
        return name, tell(name, verb, place)
    except LinkError as error:
        others = others_here(name)
        raise LinkError(f"{error}{others and '; '}{others}") from error


def release_robot(robot: str | None, endpoint: str | None = None) -> tuple[str, dict[str, Any]]:
    """Take authority from whoever holds it over a robot.

    Args:
        robot: its name; None: the only one that runs.
        endpoint: where it listens, with the certificate of an admin; None: on this machine.

    Returns:
        Its name and its answer.

    Raises:
        UsageError: several robots run, that cannot be a name, or there is no such certificate.
        LinkError: none runs, or it does not answer.
    """
    if endpoint is not None:
        if not isinstance(endpoint, Place):
            raise UsageError("--connect: over the network `release` is for an admin: give --secure")
        name = robot or only_alive(endpoint)
        return name, tell(name, "release", endpoint)
    found = find_local(robot)
    if found is None:
        others = others_here(robot or "")
        raise LinkError(
            f"no robot{f' called {robot!r}' if robot else ''} of this user runs on this machine: "
            f"run `hoap3 release` where the robot runs, as its user{others and '; '}{others}"
        )
    return found.name, _answer(found, "release")


def reach_robot(robot: str | None, endpoint: str | None) -> tuple[str, str]:
    """Name of a running robot, and where the network reaches it.

    Args, Raises:
        As for `ask_robot`.
    """
    found = find_local(robot) if endpoint is None else None
    if found is not None:
        return found.name, endpoint_of(found) or ENDPOINT
    place = ENDPOINT if endpoint is None else endpoint
    return robot or only_alive(place), place


def live_robots(endpoint: str | None) -> tuple[list[str], str]:
    """Names of the robots that are alive.

    Args:
        endpoint: where one, or a router, listens; None: on this machine, and at `ENDPOINT`.

    Returns:
        The names, those of this machine first, and why the network told none, or "".

    Raises:
        UsageError: that cannot be an endpoint.
    """
    names = [one.name for one in local_robots()] if endpoint is None else []
    try:
        names += alive(ENDPOINT if endpoint is None else endpoint)
    except LinkError as error:
        return list(dict.fromkeys(names)), str(error)
    return list(dict.fromkeys(names)), ""


def find_local(robot: str | None) -> LocalRobot | None:
    """The robot of this user on this machine; None where there is none.

    Raises:
        UsageError: there are several, or that cannot be a name.
    """
    if robot is not None:
        check_name(robot)
    found = [one for one in local_robots() if robot in (None, one.name)]
    if len(found) > 1:
        names = ", ".join(f"{one.name} at {endpoint_of(one) or 'no endpoint'}" for one in found)
        what = "Add its name" if robot is None else "Add --connect ENDPOINT"
        raise UsageError(f"{len(found)} robots run on this machine: {names}. {what}")
    return found[0] if found else None


def only_alive(endpoint: str) -> str:
    """Name of the only robot that is alive behind an endpoint.

    Raises:
        UsageError: there are several.
        LinkError: there is none.
    """
    names = alive(endpoint)
    if not names:
        raise LinkError(f"no robot is alive at {endpoint}")
    if len(names) > 1:
        raise UsageError(f"{len(names)} robots are alive: {', '.join(names)}. Name one")
    return names[0]


def endpoint_of(robot: LocalRobot) -> str | None:
    """Where the network reaches a robot on this machine; None where it does not answer."""
    try:
        endpoints = robot.ask("status").get("endpoints") or [None]
    except LinkError:
        return None
    return endpoints[0] if isinstance(endpoints[0], str) else None


def _answer(robot: LocalRobot, verb: str) -> dict[str, Any]:
    """What the robot's loop answers, checked as if it came over the network."""
    who = f"robot {robot.name!r} answers {verb!r}"
    return check_answer(ROBOT_ANSWERS[verb], robot.ask(verb), who).model_dump()
