"""A Zenoh session as this project uses it: its settings, keys, and questions to others.

Whoever needs zenoh takes it from here, so that its environment is set before it is imported.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from typing import Literal

os.environ.setdefault(
    # Read once, at import. Few threads cost least, but receiving may wait until something is sent,
    # and closing many connections that never say a word would delay the data.
    "ZENOH_RUNTIME",
    "(rx:(handover:app),tx:(worker_threads:1),acc:(worker_threads:1),net:(handover:app),"
    "app:(worker_threads:1))",
)

import zenoh

from hoap3.protocol.config.settings import LinkSettings
from hoap3.protocol.errors import LinkError, NameTakenError, PortInUseError
from hoap3.protocol.link.robot_sessions import RobotSession, name_conflict
from hoap3.protocol.link.session_limits import MAX_MESSAGE_BYTES, SIZE_FILTER, accept_limits
from hoap3.protocol.link.zenoh_sockets import forbid_lingering
from hoap3.protocol.messages import WIRE_VERSION
from hoap3.protocol.secure.credentials import read_credentials
from hoap3.protocol.secure.profile import Profile, profile
from hoap3.protocol.secure.refusals import listens, why_refused

__all__ = [
    "QUERY_TIMEOUT_S", "alive_robots", "ask", "ask_all", "certified_peers", "check_unique",
    "fast_publisher", "is_alive", "key", "open_session", "robot_sessions", "sampled_key",
    "session_name", "state_key", "zenoh",
]  # fmt: skip

QUERY_TIMEOUT_S = 2.0
CLOSE_US = 1_000_000  # a peer that takes no answer for so long is disconnected
DROP_US = 100
"""How long a State waits for room on its way to a peer that takes nothing: at each tick."""
EVENTS_AT_ONCE = 16  # that wait for one link, the most that Zenoh has room for; the rest is lost


def key(robot: str, leaf: str) -> str:
    """Key expression of one of a robot's resources."""
    return f"robots/{robot}/{leaf}"


def state_key(robot: str) -> str:
    """Return where a robot publishes its States."""
    return key(robot, f"state/{WIRE_VERSION}")


def sampled_key(robot: str, leaf: str) -> str:
    """Where messages go to those who look on: `leaf` is `state/2` or `setpoint/<who>`."""
    return key(robot, f"sampled/{leaf}")


def session_name(settings: LinkSettings, rest: str) -> str:
    """How the keys of a session end: `rest`, with certificates `<name>.<rest>`.

    Raises:
        ConfigError: the certificate cannot be used.
    """
    return read_credentials(settings.secure).session_name(rest) if settings.secure else rest


def open_session(
    settings: LinkSettings, robot: str = "", *, stamps: bool = False, loops: bool = False
) -> zenoh.Session:
    """A session that listens, connects and discovers exactly what the settings say.

    Args:
        settings: see above.
        robot: the robot that it belongs to, or is for; "" for any, of those who ask who is there.
        stamps: whether messages get a time stamp of Zenoh's, as ROS 2 wants them.
        loops: whether a loop runs over it, which must not wait while new links are seen to. A
            thread sees to them, and Python does not end until such a session is closed.

    Raises:
        PortInUseError: somebody listens on one of the endpoints.
        LinkError: an endpoint that Zenoh cannot use, or that refuses us.
        ConfigError: the certificate cannot be used.
    """
    secure = (
        profile(settings.secure, robot, settings.listen, settings.connect)
        if settings.secure
        else None
    )
    congestion = {
        "drop": {"wait_before_drop": DROP_US},
        "block": {"wait_before_close": CLOSE_US},
    }
    queue = {"congestion_control": congestion, "size": {"data_high": EVENTS_AT_ONCE}}
    config = {
        "mode": settings.mode,
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "listen": {"endpoints": list(settings.listen)},
        "connect": {
            "endpoints": list(settings.connect),
            "timeout_ms": -1 if settings.mode == "peer" else 3000,
            "exit_on_failure": settings.mode == "client",
            "retry": {"period_init_ms": 100, "period_max_ms": 200, "period_increase_factor": 1.5},
        },
        "transport": {
            "shared_memory": {"enabled": False},
            "unicast": accept_limits(),
            "link": {
                "tx": {"lease": settings.lease_ms, "queue": queue},
                "rx": {"max_message_size": MAX_MESSAGE_BYTES},
                **({} if secure is None else secure.link()),
            },
        },
        "timestamping": {"enabled": stamps},
        "low_pass_filter": [SIZE_FILTER],
        **({} if secure is None else {"access_control": secure.access_control}),
    }
    try:
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    except zenoh.ZError as error:
        text = str(error)
        endpoints = ", ".join(settings.listen or settings.connect)
        key = "link.listen" if settings.listen else "link.connect"
        if "in use" in text:
            raise PortInUseError(
                f"{endpoints} is in use: another robot runs there. Stop it, or set link.listen "
                "to a free port"
            ) from error
        if settings.mode == "client":
            raise LinkError(
                f"nothing answers at {endpoints}: {_why(settings, secure, robot)}"
            ) from error
        reason = text.partition(" at /")[0]  # without the place in Zenoh's source
        raise LinkError(f"{key}: cannot open {endpoints}: {reason}. Correct {key}") from error
    told = zenoh.handlers.Callback(_forbid_lingering, indirect=loops)
    session.info.declare_link_events_listener(told, history=True)
    return session


def _why(settings: LinkSettings, secure: Profile | None, robot: str) -> str:
    """Why a client cannot connect, as far as it can be known."""
    place = settings.connect[0]
    if secure is not None:
        return why_refused(place, secure.credentials, robot)
    if listens(place):
        return "somebody listens there, but not in plain: does it want --secure?"
    return "is the robot running, and is this its endpoint?"


def certified_peers(session: zenoh.Session) -> set[str]:
    """Names in the certificates of those that a session is connected to."""
    return {link.auth_identifier for link in session.info.links() if link.auth_identifier}


def _forbid_lingering(event: zenoh.LinkEvent) -> None:
    """For each new link."""
    if event.kind == zenoh.SampleKind.PUT:
        forbid_lingering()


def ask(
    session: zenoh.Session,
    robot: str,
    verb: str,
    who: str,
    body: bytes = b"",
    whom: Literal["ask", "control"] = "ask",
    timeout_s: float = QUERY_TIMEOUT_S,
) -> bytes | None:
    """Ask a robot ("ask"), or its controller ("control").

    The first answer is returned at once. With its default consolidation Zenoh would wait for all
    queryables, and a robot whose queue is full leaves a second copy of each `stop` unanswered.

    Args:
        session: that reaches it.
        robot: its name.
        verb, who, body: see `hoap3.protocol.link.base.Request`.
        whom: see above.
        timeout_s: time for the answer [s].

    Returns:
        The answer; None where nobody gives one in time.
    """
    target, at_once = key(robot, f"{whom}/{verb}/{who}"), zenoh.ConsolidationMode.NONE
    return _first(session.get(target, payload=body, timeout=timeout_s, consolidation=at_once))


def ask_all(session: zenoh.Session, robot: str, verb: str, who: str, count: int) -> list[bytes]:
    """Answers of all robots of one name; returns once there are `count` of them."""
    at_once, found = zenoh.ConsolidationMode.NONE, list[bytes]()
    target, everyone = key(robot, f"ask/{verb}/{who}"), zenoh.QueryTarget.ALL
    for reply in session.get(
        target, target=everyone, timeout=QUERY_TIMEOUT_S, consolidation=at_once
    ):
        if reply.ok is not None:
            found.append(reply.ok.payload.to_bytes())
            if len(found) >= count:
                break
    return found


def _first(replies: Iterable[zenoh.Reply]) -> bytes | None:
    """The first answer of those that are one; None where there is none."""
    for reply in replies:
        if reply.ok is not None:
            return reply.ok.payload.to_bytes()
    return None


def alive_robots(session: zenoh.Session) -> list[str]:
    """Names of the robots that are alive where the session reaches."""
    replies = session.liveliness().get(key("*", "alive"), timeout=QUERY_TIMEOUT_S)
    names = {str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok}
    certified = certified_peers(session)
    return sorted(names & certified if certified else names)


def robot_sessions(session: zenoh.Session, robot: str = "*") -> list[tuple[str, RobotSession]]:
    """Names and sessions of the robots that hold a session token, sorted."""
    replies = session.liveliness().get(key(robot, "session/*"), timeout=0.5)
    tokens = {str(reply.ok.key_expr) for reply in replies if reply.ok}
    read = ((token.split("/")[1], RobotSession.read(token)) for token in tokens)
    return sorted((name, found) for name, found in read if found is not None)


def check_unique(session: zenoh.Session, robot: str) -> None:
    """Refuse to use a name that several robots have.

    Raises:
        NameTakenError: names the endpoint of each.
    """
    sessions = [found for _, found in robot_sessions(session, robot)]
    if len(sessions) > 1:
        raise NameTakenError(name_conflict(robot, sessions))


def is_alive(session: zenoh.Session, robot: str) -> bool:
    """Whether a robot of that name holds its liveliness token."""
    replies = session.liveliness().get(key(robot, "alive"), timeout=0.5)
    return any(reply.ok is not None for reply in replies)


def event_publisher(session: zenoh.Session, expression: str) -> zenoh.Publisher:
    """Publisher whose samples wait for nothing but the loops' own, and for each other."""
    return session.declare_publisher(expression, express=True, priority=zenoh.Priority.DATA_HIGH)


def fast_publisher(session: zenoh.Session, expression: str, blocking: bool) -> zenoh.Publisher:
    """Publisher whose samples are neither batched nor queued behind others."""
    control = zenoh.CongestionControl
    return session.declare_publisher(
        expression,
        express=True,
        priority=zenoh.Priority.REAL_TIME,
        congestion_control=control.BLOCK if blocking else control.DROP,
    )
