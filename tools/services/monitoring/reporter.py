"""What an observer says of its service: lines for people, news for whoever started it."""

from __future__ import annotations

import json
import os
from typing import Any, TextIO

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Record
from hoap3.protocol.stop_reasons import STOP_REASONS, stop_words
from hoap3.tools.machine.processes import to_people
from hoap3.tools.services.monitoring.json_lines import OF_NEWS, JsonLines
from hoap3.tools.show.event_words import (
    CONDITIONS,
    EVENT_NAMES,
    event_name,
    in_words,
    is_routine,
    severity,
)

EVENTS = Event.schema.constants
FREQUENT = {EVENTS[name] for name in ("SKIPPED", "OVERWRITTEN", "HOST_STALL")}


class Reporter:
    """Tells people, or the process that asked for it, what happens.

    Args:
        status_fd: pipe to that process; None for people.
        side, robot: of the service.
        lines: that all of it is written to as well, if any.
        quiet: tell people nothing, since these lines stand in their place.
    """

    def __init__(
        self,
        status_fd: int | None,
        side: str,
        robot: str,
        lines: JsonLines | None = None,
        *,
        quiet: bool = False,
    ) -> None:
        self._status: TextIO | None = None if status_fd is None else os.fdopen(status_fd, "w")
        self._side, self._robot = side, robot
        self._lines, self._quiet = lines, quiet
        self._session: dict[str, int | str] = {}
        self._conditions: tuple[str, ...] = ()  # names that the controller gives
        self._joints: tuple[str, ...] = ()
        self._told: set[int] = set()

    def send(self, news: str, content: dict[str, Any]) -> None:
        """One JSON line, where somebody reads them."""
        if self._status is None:
            return
        try:
            self._status.write(json.dumps({"news": news, "side": self._side, **content}) + "\n")
            self._status.flush()
        except BrokenPipeError:
            self._status = None  # whoever asked is gone; the log goes on

    def say(self, text: str, news: str = "said") -> None:
        """One line for people; of which kind, for the process that asked for it."""
        self._tell(news, {"text": f"{self._side}: {text}"})
        if self._lines is not None:
            grade, name = OF_NEWS[news]
            self._lines.write(grade, name, text, more=self._session)

    def sum_up(self, text: str) -> None:
        """The last line, for machines alone: people get a table."""
        if self._lines is not None:
            self._lines.write("info", "summary", text, more=self._session)
            self._lines.close()

    def description(self, record: Record) -> None:
        """Learn the names of the joints."""
        self._joints = RobotDescription.from_json(record.payload).joint_names

    def session(self, record: Record) -> None:
        """Learn what the following events are about."""
        session = json.loads(record.payload)
        self._conditions = tuple(session.get("conditions", ()))
        self._session = {"session": str(session["session_id"])}
        self._told.clear()

    def event(self, record: Record) -> None:
        """One line for people; of a condition, when it holds for the first time."""
        event = Event()
        event.load(record.payload)
        if event.kind in FREQUENT:
            return  # hundreds on a busy machine; they are counted, and stand in the log
        if event.kind in CONDITIONS:
            if event.detail in self._told:
                return  # it may come and go; the log has it all
            self._told.add(event.detail)
        name = event_name(event.kind, event.detail)
        words = in_words(event.kind, event.detail, self._joints, self._conditions)
        what = f"{name} ({words})" if words else name
        if self._side == "controller" and event.kind == EVENTS["SAFE_STOP"]:
            stopped = stop_words(STOP_REASONS.get(event.detail))
            what = f"robot {self._robot!r}: {stopped}; it waits to be recovered"
        text = f"{self._side}: tick {event.tick}: {what}"
        content = {"text": text, "kind": name, "tick": event.tick, "detail": event.detail}
        routine = is_routine(event.kind, event.detail)
        self._tell("event", {**content, "routine": routine})
        if self._lines is not None:
            self._lines.write(
                severity(event.kind, event.detail),
                EVENT_NAMES.get(event.kind, str(event.kind)),
                what,
                stamp=record.stamp,
                more={**self._session, "tick": event.tick, "detail": event.detail},
            )

    def _tell(self, news: str, content: dict[str, Any]) -> None:
        if self._status is None and not self._quiet:
            to_people(content["text"])
        self.send(news, content)
