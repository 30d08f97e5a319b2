"""What an observer says of its service: lines for people, news for whoever started it."""

from __future__ import annotations

import json
import os
from typing import Any, TextIO

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Record
from hoap3.protocol.stop_reasons import STOP_REASONS, stop_words
from hoap3.tools.machine.processes import to_people
from hoap3.tools.show.event_words import CONDITIONS, event_name, in_words, is_routine

EVENTS = Event.schema.constants
FREQUENT = {EVENTS[name] for name in ("SKIPPED", "OVERWRITTEN", "HOST_STALL")}


class Reporter:
    """Tells people, or the process that asked for it, what happens."""

    def __init__(self, status_fd: int | None, side: str, robot: str) -> None:
        self._status: TextIO | None = None if status_fd is None else os.fdopen(status_fd, "w")
        self._side, self._robot = side, robot
        self._conditions: tuple[str, ...] = ()  # names that the controller gives
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

    def session(self, record: Record) -> None:
        """Learn what the following events are about."""
        self._conditions = tuple(json.loads(record.payload).get("conditions", ()))
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
        words = in_words(event.kind, event.detail, (), self._conditions)
        what = f"{name} ({words})" if words else name
        if self._side == "controller" and event.kind == EVENTS["SAFE_STOP"]:
            stopped = stop_words(STOP_REASONS.get(event.detail))
            what = f"robot {self._robot!r}: {stopped}; it waits to be recovered"
        text = f"{self._side}: tick {event.tick}: {what}"
        content = {"text": text, "kind": name, "tick": event.tick, "detail": event.detail}
        routine = is_routine(event.kind, event.detail)
        self._tell("event", {**content, "routine": routine})

    def _tell(self, news: str, content: dict[str, Any]) -> None:
        if self._status is None:
            to_people(content["text"])
        self.send(news, content)
