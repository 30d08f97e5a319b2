"""Which running robot is meant: the one that is named, or else the only one that runs.

Without an endpoint, robots of this user on this machine come first; asking them needs no network.
"""

from __future__ import annotations

from typing import Any

from hoap3.protocol.answers import ROBOT_ANSWERS, check_answer
from hoap3.protocol.config.endpoints import Place, over_tls
from hoap3.protocol.errors import Hoap3Error, LinkError, UsageError
from hoap3.protocol.link.local_control import NOT_STARTED, LocalRobot, local_robots, others_here
from hoap3.protocol.runtime.private_directory import no_directory
from hoap3.protocol.secure.refusals import listens
from hoap3.tools.services.client import (
    ENDPOINT,
    alive,
    check_name,
    check_right,
    client_settings,
    tool_client,
)

Answer = dict[str, Any]
REMEDY = "Start it (`hoap3 emulator`), or give its endpoint: --connect, in Python `endpoint=`"

STARTING = "; one that was just started answers as soon as its kernels are compiled"


def ask_robots(
    robot: str | None, verb: str, endpoint: str | None
) -> tuple[list[Answer], list[str]]:
    """Ask a running robot something; with "stop" or "status" all robots of one name.

    Args:
        robot: its name; None: the only one that runs.
        verb: "stop", "recover" or "status".
        endpoint: as for `reach_robot`.

    Returns:
        The answer of each, with `robot`, its name, `endpoint` and `pid`; and why some gave none.

    Raises:
        UsageError, LinkError: as for `reach_robot`, or none answers.
        WireError: its answer makes no sense.
    """
    if isinstance(endpoint, Place):
        check_right(client_settings(endpoint or Place(over_tls(ENDPOINT), endpoint.secure)), verb)
    found = _find_all(robot) if endpoint is None else []
    if not found:
        name, place = reach_robot(robot, endpoint)
        return [{"robot": name, **each} for each in request_all(name, verb, place)], []
    if verb not in {"stop", "status"}:
        _refuse_several(found)
    given, failures = list[Answer](), list[Hoap3Error]()
    for one in found:
        try:
            given.append(_answer(one, verb))
        except Hoap3Error as error:
            failures.append(error)
    if not given:
        raise failures[0]
    name, here = found[0].name, {each["session_id"] for each in given}
    conflicting = [each for each in given if each.get("name_conflicts")]
    for place in {each["endpoint"] for each in conflicting if each["endpoint"]}:
        try:
            reached = request_all(name, verb, place)
        except Hoap3Error as error:
            failures.append(error)
            continue
        others = [each for each in reached if each["session_id"] not in here]
        given += [{"robot": name, **each} for each in others]
        here |= {each["session_id"] for each in others}
    return given, [str(error) for error in failures]


def release_robot(robot: str | None, endpoint: str | None = None) -> tuple[str, Answer]:
    """Release the authority over a robot, whichever client holds it.

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
        name, place = reach_robot(robot, endpoint)
        return name, request_all(name, "release", place)[0]
    found = find_local(robot)
    if found is None:
        raise _none_here(robot, ": run `hoap3 release` where the robot runs, as its user")
    answer = _answer(found, "release")
    return found.name, {"released": answer["released"]}


def request_all(robot: str, verb: str, place: str) -> list[Answer]:
    """Send a request over the network; see `RobotClient.request_all`."""
    check_right(client_settings(place), verb)
    with tool_client(robot, place) as client:
        return client.request_all(verb)


def reach_robot(robot: str | None, endpoint: str | None) -> tuple[str, str]:
    """Name of a running robot, and the endpoint at which the network reaches it.

    Everything that connects to a running robot finds it here: commands, `hoap3.connect`, bridges
    and the live page.

    Args:
        robot: its name; None: the only one that runs.
        endpoint: where it, or a router, listens; None or empty: that of the robot of this user on
            this machine, else `ENDPOINT`. A `Place` has a certificate.

    Raises:
        UsageError: several robots run, or that cannot be a name, or an endpoint.
        LinkError: none runs, or it does not answer.
    """
    if robot is not None:
        check_name(robot)
    if endpoint is not None and (endpoint or not isinstance(endpoint, Place)):
        return robot or only_alive(endpoint), endpoint
    found = find_local(robot)
    place = ENDPOINT if found is None else endpoint_of(found)
    if found is None and not listens(place):
        raise _none_here(robot, f", and nothing answers at {place}. {REMEDY}")
    if isinstance(endpoint, Place):
        place = Place(over_tls(place), endpoint.secure)
    return found.name if found else robot or only_alive(place), place


def live_robots(endpoint: str | None) -> tuple[list[Answer], str]:
    """The robots that are alive, a session each.

    Args:
        endpoint: where one, or a router, listens; None: on this machine, and at `ENDPOINT`.

    Returns:
        `robot`, `endpoint`, `pid`, `host` and `session_id` of each, those of this machine first,
        None where not known; and why the network gave none, or "".

    Raises:
        UsageError: that cannot be an endpoint.
    """
    found = [_local(one) for one in local_robots()] if endpoint is None else []
    found = [each for each in found if each.pop("mode") != "starting"]
    here = {(each["robot"], each["pid"]) for each in found}
    place = ENDPOINT if endpoint is None else endpoint
    if isinstance(place, Place) and not place:
        place = Place(over_tls(ENDPOINT), place.secure)
    try:
        found += [each for each in alive(place) if (each["robot"], each["pid"]) not in here]
    except LinkError as error:
        return found, str(error)
    return found, ""


def find_local(robot: str | None) -> LocalRobot | None:
    """The robot of this user on this machine; None where there is none.

    Raises:
        UsageError: there are several, or that cannot be a name.
    """
    found = _find_all(robot)
    _refuse_several(found)
    return found[0] if found else None


def _find_all(robot: str | None) -> list[LocalRobot]:
    """All robots of one name of this user on this machine.

    Raises:
        UsageError: they have several names, or that cannot be a name.
    """
    if robot is not None:
        check_name(robot)
    found = [one for one in local_robots() if robot in (None, one.name)]
    if len(found) > 1:
        found = [one for one in found if not one.starting] or found
    if len({one.name for one in found}) > 1:
        _refuse_several(found)
    return found


def _refuse_several(found: list[LocalRobot]) -> None:
    if len(found) < 2:
        return
    same = len({one.name for one in found}) == 1
    what = "Give its endpoint: --connect, in Python `endpoint=`" if same else "Add its name"
    listed, name = ", ".join(map(str, found)), f" called {found[0].name!r}" if same else ""
    raise UsageError(f"{len(found)} robots{name} run on this machine: {listed}. {what}")


def _none_here(robot: str | None, remedy: str) -> LinkError:
    name = f" called {robot!r}" if robot else ""
    notes = "".join(f"; {note}" for note in (others_here(robot or ""), no_directory()) if note)
    return LinkError(f"no robot{name} of this user runs on this machine{remedy}{notes or STARTING}")


def only_alive(endpoint: str) -> str:
    """Name of the only robot that is alive behind an endpoint.

    Raises:
        UsageError: there are several.
        LinkError: there is none.
    """
    names = sorted({str(each["robot"]) for each in alive(endpoint)})
    if not names:
        raise LinkError(f"no robot is alive at {endpoint}{STARTING}")
    if len(names) > 1:
        raise UsageError(f"{len(names)} robots are alive: {', '.join(names)}. Name one")
    return names[0]


def endpoint_of(robot: LocalRobot) -> str:
    """Where the network reaches a robot on this machine.

    Raises:
        LinkError: it does not answer, has not started yet, or Zenoh does not reach it.
    """
    answer = robot.ask("status")
    if answer.get("mode") == "starting":
        raise LinkError(f"robot {robot.name!r} (process {robot.pid}) {NOT_STARTED}")
    place = str((answer.get("endpoints") or [""])[0])
    if not place or place.startswith("hoap3_tcp/"):
        raise LinkError(
            f"robot {robot.name!r} (process {robot.pid}) has no endpoint of Zenoh "
            f"({place or 'none'}): only status, stop, recover and release on its machine reach it"
        )
    return place


def _local(robot: LocalRobot) -> Answer:
    """What identifies a robot of this machine, as far as it answers."""
    try:
        answer = robot.ask("status")
    except LinkError:
        answer = {}
    place = (answer.get("endpoints") or [None])[0]
    found = {"robot": robot.name, "endpoint": place, "pid": robot.pid, "host": None}
    return {**found, "session_id": answer.get("session_id"), "mode": answer.get("mode")}


def _answer(robot: LocalRobot, verb: str) -> Answer:
    """What the robot's loop answers, checked as if it came over the network."""
    raw = robot.ask(verb)
    who = f"robot {robot.name!r} answers {verb!r}"
    answer = check_answer(ROBOT_ANSWERS[verb], raw, who).model_dump()
    place = (raw.get("endpoints") or [None])[0]
    return {"robot": robot.name, **answer, "endpoint": place, "pid": robot.pid}
