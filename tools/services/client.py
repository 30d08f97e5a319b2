"""The client of a running robot, for `hoap3 stop`, `recover`, `status`, `change`, `connect`."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable
from typing import Any, Literal, Self

from hoap3.protocol.answers import MAX_CONTROL_BYTES, ROBOT_ANSWERS, ControlAnswer, parse_answer
from hoap3.protocol.config.endpoints import Place, endpoint_fault
from hoap3.protocol.config.settings import LinkSettings, parse
from hoap3.protocol.config.wrong_settings import NAME_PATTERN
from hoap3.protocol.errors import ConfigError, LinkError, UsageError, WireError

ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a robot listens by default."""
LOOK_S = 5e-4  # between two looks for what has come


class RobotClient:
    """A session on the network for requests to one robot and to its controller.

    Args:
        robot: its name.
        endpoint: where it, or a router, listens.
        name: of this client.

    Attributes:
        who: our name on the network.

    Raises:
        UsageError: that cannot be the name of a robot, or an endpoint.
        LinkError: it cannot be reached.
    """

    def __init__(self, robot: str, endpoint: str, name: str) -> None:
        from hoap3.protocol.link import zenoh_session as network

        check_name(robot)
        settings = client_settings(endpoint)
        self.robot, self.who = robot, network.session_name(settings, name)
        self._network, self._settings, self._endpoint = network, settings, endpoint
        self._session = network.open_session(settings, robot)

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """Leave the network."""
        self._session.close()

    def request_all(self, verb: str) -> list[dict[str, Any]]:
        """Send a request to the robot; "stop" and "status" to all robots of that name.

        Args:
            verb: "stop", "recover", "release" or "status".

        Returns:
            The answer of each, with `endpoint` and `pid`, None where its token does not have them.

        Raises:
            UsageError: our role does not allow it, or several robots have the name.
            LinkError: none answers.
            WireError: its answer makes no sense.
        """
        robot, network, session = self.robot, self._network, self._session
        sessions = [found for _, found in network.robot_sessions(session, robot)]
        if verb not in {"stop", "status"}:
            network.check_unique(session, robot)
        replies = network.ask_all(session, robot, verb, self.who, max(len(sessions), 1))
        if not replies:
            look = f"`hoap3 list --live`{unanswered(self._settings)}"
            raise LinkError(f"no robot called {robot!r} answers at {self._endpoint}: {look}")
        answers = [self._parsed(verb, reply) for reply in replies]
        for answer in answers:
            of_it = [one for one in sessions if one.session_id == answer.get("session_id")]
            answer["endpoint"] = of_it[0].endpoint if of_it else str(self._endpoint)
            answer["pid"] = of_it[0].pid if of_it else None
            sessions = [one for one in sessions if one not in of_it[:1]]
        return answers

    def request(self, verb: str) -> dict[str, Any]:
        """Send a request to the robot.

        Raises:
            LinkError, WireError: no answer, or one that makes no sense.
        """
        return self._parsed(verb, self._ask(verb))

    def control(self, verb: str, body: bytes = b"") -> dict[str, Any]:
        """Send a request to the robot's controller; its state afterwards.

        Raises:
            LinkError: the robot follows no controller.
            UsageError: the controller refuses; says why.
            WireError: its answer makes no sense.
        """
        raw = self._ask(verb, body, "control")
        who = f"the controller of {self.robot!r} answers {verb!r}"
        answer = parse_answer(ControlAnswer, raw, who, MAX_CONTROL_BYTES)
        if answer.now is None:
            raise UsageError(answer.error or "the controller refuses, and gives no reason")
        return answer.now

    def _parsed(self, verb: str, reply: bytes) -> dict[str, Any]:
        who = f"robot {self.robot!r} answers {verb!r}"
        return parse_answer(ROBOT_ANSWERS[verb], reply, who).model_dump()

    def _ask(self, verb: str, body: bytes = b"", whom: Literal["ask", "control"] = "ask") -> bytes:
        self._check_open()
        check_right(self._settings, verb, controller=whom == "control")
        if verb not in {"stop", "status"}:
            self._network.check_unique(self._session, self.robot)
        reply = self._network.ask(self._session, self.robot, verb, self.who, body, whom)
        if reply is not None:
            return bytes(reply)
        look = f"`hoap3 status --connect {self._endpoint}`"
        if whom == "ask":
            look += unanswered(self._settings)
            raise LinkError(f"no robot called {self.robot!r} answers {verb!r}: {look}")
        raise LinkError(
            f"no controller of robot {self.robot!r} answers {verb!r}: {look} says whom it follows"
            f"{unanswered(self._settings)}. One that starts for the first time compiles for some "
            "tens of seconds. In lockstep a controller answers only while its robot moves"
        )

    def _check_open(self) -> None:
        if self._session.is_closed():
            raise LinkError(f"the connection to robot {self.robot!r} was closed: connect again")


def tool_client(robot: str, endpoint: str) -> RobotClient:
    """A client for one request of a command."""
    return RobotClient(robot, endpoint, f"tool-{os.getpid()}")


def task_errors(robot: str, endpoint: str) -> list[dict[str, Any]] | None:
    """How the tasks of a running robot's controller stand, as its outcome will have them.

    Args:
        robot: its name.
        endpoint: where it, or a router, listens.

    Returns:
        None where they are not known: no controller, an older one, or one of somebody else.
    """
    try:
        with tool_client(robot, endpoint) as client:
            tasks = client.control("tasks").get("tasks")
    except (LinkError, UsageError, WireError):
        return None
    told = isinstance(tasks, list) and all(isinstance(each, dict) for each in tasks)
    return tasks if told else None


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
