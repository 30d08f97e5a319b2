"""`hoap3 stop`, `recover`, `status`, `change` and `list --live`: words with what runs."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Mapping
from typing import Any

from hoap3.protocol.answers import MAX_CONTROL_BYTES, ROBOT_ANSWERS, ControlAnswer, parse_answer
from hoap3.protocol.config.endpoints import Place, endpoint_fault
from hoap3.protocol.config.settings import LinkSettings, parse
from hoap3.protocol.config.wrong_settings import NAME_PATTERN
from hoap3.protocol.errors import ConfigError, LinkError, UsageError, WireError

ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a robot listens by default."""
LOOK_S = 5e-4  # between two looks for what has come


def request_all(robot: str, verb: str, endpoint: str) -> list[dict[str, Any]]:
    """Send a request to a running robot; "stop" and "status" to all robots of that name.

    Args:
        robot: its name.
        verb: "stop", "recover", "release" or "status".
        endpoint: where it, or a router, listens.

    Returns:
        The answer of each, with `endpoint` and `pid`, None where its token does not have them.

    Raises:
        UsageError: that cannot be the name of a robot, or an endpoint, or several robots have it.
        LinkError: it cannot be reached.
        WireError: its answer makes no sense.
    """
    from hoap3.protocol.link import zenoh_session as network

    check_name(robot)
    settings = client_settings(endpoint)
    check_right(settings, verb)
    me = network.session_name(settings, f"tool-{os.getpid()}")
    with network.open_session(settings, robot) as session:
        sessions = [found for _, found in network.robot_sessions(session, robot)]
        if verb not in {"stop", "status"}:
            network.check_unique(session, robot)
        replies = network.ask_all(session, robot, verb, me, max(len(sessions), 1))
        if not replies and (reply := network.ask(session, robot, verb, me)) is not None:
            replies = [reply]  # of a robot with version 1 of the wire
    if not replies:
        look = f"`hoap3 list --live`{unanswered(settings)}"
        raise LinkError(f"no robot called {robot!r} answers at {endpoint}: {look}")
    who = f"robot {robot!r} answers {verb!r}"
    answers = [parse_answer(ROBOT_ANSWERS[verb], each, who).model_dump() for each in replies]
    for answer in answers:
        of_it = [one for one in sessions if one.session_id == answer.get("session_id")]
        answer["endpoint"] = of_it[0].endpoint if of_it else str(endpoint)
        answer["pid"] = of_it[0].pid if of_it else None
        sessions = [one for one in sessions if one not in of_it[:1]]
    return answers


def change(robot: str, request: Mapping[str, Any] | None, endpoint: str) -> dict[str, Any]:
    """Have the controller of a running robot change something.

    Args:
        robot: its name.
        request: what shall be otherwise; None: only ask.
        endpoint: where the robot, or a router, listens.

    Returns:
        What can be changed, as it is now.

    Raises:
        UsageError: that cannot be the name of a robot, or an endpoint, or the controller refuses.
        LinkError: the robot cannot be reached, or follows no controller.
        WireError: the controller's answer makes no sense.
    """
    if request is None:
        return _ask_controller(robot, "show", b"", endpoint)
    from hoap3.tools.services import sent

    return _ask_controller(robot, "change", sent.request(request, {}), endpoint)


def task_errors(robot: str, endpoint: str) -> list[dict[str, Any]] | None:
    """How the tasks of a running robot's controller stand, as its outcome will have them.

    Args:
        robot: its name.
        endpoint: where it, or a router, listens.

    Returns:
        None where nobody tells: no controller, an older one, or one of somebody else.
    """
    try:
        tasks = _ask_controller(robot, "tasks", b"", endpoint).get("tasks")
    except (LinkError, UsageError, WireError):
        return None
    told = isinstance(tasks, list) and all(isinstance(each, dict) for each in tasks)
    return tasks if told else None


def _ask_controller(robot: str, verb: str, body: bytes, endpoint: str) -> dict[str, Any]:
    """What the controller of a running robot answers."""
    from hoap3.protocol.link.zenoh_session import ask, check_unique, open_session, session_name

    check_name(robot)
    settings = client_settings(endpoint)
    check_right(settings, verb, controller=True)
    me = session_name(settings, f"tool-{os.getpid()}")
    with open_session(settings, robot) as session:
        check_unique(session, robot)
        reply = ask(session, robot, verb, me, body, whom="control")
    if reply is None:
        raise LinkError(
            f"no controller of a robot called {robot!r} answers at {endpoint}: `hoap3 status` says "
            "whom it follows. In lockstep a controller answers only while its robot moves"
            f"{unanswered(settings)}"
        )
    who = f"the controller of {robot!r} answers {verb!r}"
    answer = parse_answer(ControlAnswer, reply, who, MAX_CONTROL_BYTES)
    if answer.now is None:
        raise UsageError(answer.error or "the controller refuses, and gives no reason")
    return answer.now


def client_settings(endpoint: str) -> LinkSettings:
    """Settings of a client that connects to one endpoint; of a `Place` with its certificate.

    Raises:
        ConfigError: not the form of an endpoint, or no port, or not one for a certificate.
    """
    fault = endpoint_fault(endpoint)
    if fault is not None:
        raise ConfigError("--connect", "", endpoint, *fault)
    secure = endpoint.secure if isinstance(endpoint, Place) else None
    content = {"connect": [str(endpoint)], "mode": "client", "secure": secure}
    return parse(LinkSettings, content, "--connect")


def check_right(settings: LinkSettings, verb: str, *, controller: bool = False) -> None:
    """Refuse at once what the role in our own certificate does not allow; the robot refuses too.

    Raises:
        UsageError: another role may do that.
    """
    if settings.secure is None:
        return
    from hoap3.protocol.secure.credentials import read_credentials
    from hoap3.protocol.secure.roles import roles_that_ask

    ours = read_credentials(settings.secure)
    wanted = roles_that_ask(verb, controller=controller)
    if wanted and ours.role not in wanted:
        raise UsageError(
            f"{ours.name!r} is {ours.role} by its certificate: {verb!r} is for {', '.join(wanted)}"
        )


def unanswered(settings: LinkSettings) -> str:
    """What else silence may mean to who comes with a certificate; "" without one."""
    if settings.secure is None:
        return ""
    from hoap3.protocol.secure.credentials import read_credentials

    ours = read_credentials(settings.secure)
    return f"; does its access.yaml list {ours.name!r} as {ours.role}?"


def check_name(robot: str) -> None:
    """Refuse what is no name of one robot, such as a wildcard."""
    if not re.fullmatch(NAME_PATTERN, robot):
        raise UsageError(
            f"{robot!r:.80} is not the name of a robot: write a-z, 0-9 and _, 32 at most"
        )


def alive(endpoint: str) -> list[dict[str, Any]]:
    """The robots that are alive behind an endpoint, a session each.

    Returns:
        `robot`, `endpoint`, `pid`, `host` and `session_id`; None where not known.

    Raises:
        UsageError: that cannot be an endpoint.
        LinkError: it cannot be reached.
    """
    from hoap3.protocol.link.zenoh_session import alive_robots, open_session, robot_sessions

    with open_session(client_settings(endpoint)) as session:
        names = [name for name in alive_robots(session) if re.fullmatch(NAME_PATTERN, name)]
        sessions = robot_sessions(session)
    found = [{"robot": name, **one._asdict()} for name, one in sessions if name in names]
    known = {each["robot"] for each in found}
    keys = ("robot", "endpoint", "pid", "host", "session_id")
    found += [{"robot": name} for name in names if name not in known]
    return [{key: each.get(key) for key in keys} for each in found]


def place_of(endpoint: str | None, secure: str | os.PathLike[str] | None) -> str | None:
    """Where a robot is, and with which certificate it is reached."""
    return endpoint if secure is None else Place(endpoint or "", os.fspath(secure))


def wait_for(look: Callable[[], Any], timeout_s: float) -> Any:
    """What a look finds, once it finds something, or after so long.

    The last look is after that: this process may have been stopped meanwhile.
    """
    until = time.monotonic() + timeout_s
    while True:
        over = time.monotonic() > until
        found = look()
        if found or over:
            return found
        time.sleep(LOOK_S)
