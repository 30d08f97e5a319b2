"""What the page asks a robot and its controller, each answer checked as any from the network."""

from __future__ import annotations

from typing import Any

from pydantic_core import from_json

from hoap3.protocol.answers import (
    MAX_CONTROL_BYTES,
    ROBOT_ANSWERS,
    ControlAnswer,
    parse_answer,
    parse_description,
)
from hoap3.protocol.errors import LinkError, WireError
from hoap3.protocol.link.session_limits import MAX_CONFIG_BYTES
from hoap3.protocol.robot.description import RobotDescription

Answer = dict[str, Any]


class Questions:
    """Asks one robot, and its controller.

    Args:
        session: of Zenoh.
        robot: its name.
        who: asks.
        endpoint: where the session leads, for errors.
    """

    def __init__(self, session: Any, robot: str, who: str, endpoint: str) -> None:
        from hoap3.protocol.link.zenoh_session import ask, check_unique

        self._put, self._session = ask, session
        self._check_unique = check_unique
        self._robot, self._who, self._endpoint = robot, who, endpoint

    def description(self) -> RobotDescription:
        """Of the robot.

        Raises:
            NameTakenError: several robots use the name.
            LinkError: nothing answers.
            WireError: the answer makes no sense.
        """
        self._check_unique(self._session, self._robot)
        raw = self._put(self._session, self._robot, "description", self._who)
        if raw is None:
            look = f"`hoap3 list --live --connect {self._endpoint}`"
            raise LinkError(f"no robot called {self._robot!r} answers at {self._endpoint}: {look}")
        return parse_description(raw, self._robot)

    def status(self) -> Answer | None:
        """Of the robot; None where it does not answer, or with nonsense."""
        raw = self._ask("status")
        if raw is None:
            return None
        try:
            who = f"robot {self._robot!r} answers 'status'"
            return parse_answer(ROBOT_ANSWERS["status"], raw, who).model_dump()
        except WireError:
            return None

    def stop(self) -> Answer:
        """Have the robot brake and stay at rest.

        Raises:
            LinkError: nothing answers.
            WireError: the answer makes no sense.
        """
        raw = self._ask("stop")
        if raw is None:
            raise LinkError(f"robot {self._robot!r} at {self._endpoint} does not answer 'stop'")
        who = f"robot {self._robot!r} answers 'stop'"
        return parse_answer(ROBOT_ANSWERS["stop"], raw, who).model_dump()

    def config(self) -> Answer | None:
        """The robot's configuration; None where it does not tell."""
        raw = self._ask("config") or b""
        if len(raw) > MAX_CONFIG_BYTES:
            return None
        try:
            found = from_json(raw, allow_inf_nan=False)
        except ValueError:
            return None
        return found if isinstance(found, dict) and "error" not in found else None

    def control(self, verb: str) -> Answer | None:
        """What the controller answers; None where it does not, or refuses."""
        raw = self._ask(verb, "control")
        try:
            who = f"the controller of {self._robot!r} answers {verb!r}"
            return parse_answer(ControlAnswer, raw or b"", who, MAX_CONTROL_BYTES).now
        except WireError:
            return None

    def _ask(self, verb: str, whom: Any = "ask") -> bytes | None:
        return self._put(self._session, self._robot, verb, self._who, whom=whom)
