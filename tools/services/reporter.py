"""What an observer reports: lines for people, JSON lines, or messages to what started its service.

With JSON lines both processes of a service write to standard output: the service its own messages,
its observer the events of the loop. No loop writes: see `QueuedLines`.
"""

from __future__ import annotations

import errno
import json
import os
import queue
import threading
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any, Literal

from hoap3.protocol.messages import Event
from hoap3.protocol.robot.description import RobotDescription
from hoap3.protocol.runtime.notes import NoteKind
from hoap3.protocol.runtime.shm_ring import Record
from hoap3.protocol.stop_reasons import STOP_REASONS, stop_words
from hoap3.tools.analysis.event_words import (
    CONDITIONS,
    EVENT_NAMES,
    event_name,
    in_words,
    is_routine,
    severity,
)
from hoap3.tools.machine.processes import to_people
from hoap3.tools.services.messages import LoopEvent, MessageSender, StatusMessage

Severity = Literal["debug", "info", "warning", "error"]
OF_NEWS: dict[str, tuple[Severity, str]] = {
    "detail": ("debug", "said"),
    "compiling": ("info", "compiling"),
    "routine": ("info", "said"),
    "said": ("warning", "said"),
    "not granted": ("warning", "not_granted"),
    "damaged": ("error", "log_lost"),
    "unserved": ("error", "metrics_lost"),
    "failed": ("error", "failed"),
}
"""Severity and name of what is no event of a loop, by its kind between processes."""
STDOUT = 1


def facts_of(side: str, robot: str) -> dict[str, str]:
    """Members of every line of a service."""
    return {"service": "emulator" if side == "robot" else side, "robot": robot}


class JsonLines:
    """Writes lines to standard output; an error is reported once, and ends nothing.

    A line that could not be written is counted, and the next one that can be gives the count.

    Args:
        facts: members of every line, such as `service` and `robot`.
        complain: receives why lines are missing, for people.
    """

    def __init__(self, facts: Mapping[str, str], complain: Callable[[str], None]) -> None:
        self._facts, self._complain, self._lost, self._problem = dict(facts), complain, 0, ""

    def write(
        self,
        severity: Severity,
        event: str,
        text: str,
        *,
        stamp: int | None = None,
        more: Mapping[str, int | str] | None = None,
    ) -> None:
        """Write one line.

        Args:
            severity, event, text: of what happened.
            stamp: monotonic clock when it happened [ns]; None: now.
            more: further members, such as `session` and `tick`.
        """
        line = self._line(severity, event, text, stamp, more or {})
        if self._lost:
            lost = f"{self._lost} lines could not be written: {self._problem}"
            line = self._line("warning", "lines_lost", lost, None, {"lines": self._lost}) + line
        try:
            if os.write(STDOUT, line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            if not self._lost:
                self._problem = error.strerror or str(error)
                self._complain(f"JSON lines are missing: {self._problem}; it goes on without")
            self._lost += 1
        else:
            self._lost = 0

    def _line(
        self,
        severity: str,
        event: str,
        text: str,
        stamp: int | None,
        more: Mapping[str, int | str],
    ) -> bytes:
        line = {
            "time": datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "monotonic_ns": time.monotonic_ns() if stamp is None else stamp,
            "severity": severity,
            **self._facts,
            "event": event,
            **more,
            "text": text,
        }
        return json.dumps(line).encode() + b"\n"


class QueuedLines:
    """The same for a process whose loop must not wait for a reader: a thread writes.

    The thread sleeps until there is a line.
    """

    def __init__(self, lines: JsonLines) -> None:
        self._lines = lines
        self._queue: queue.SimpleQueue[tuple[Any, ...] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="json lines", daemon=True)
        self._thread.start()

    def write(self, severity: Severity, event: str, text: str) -> None:
        """Queue a line."""
        self._queue.put((severity, event, text, time.monotonic_ns()))

    def close(self) -> None:
        """Return once all of it is written."""
        self._queue.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (said := self._queue.get()) is not None:
            severity, event, text, stamp = said
            self._lines.write(severity, event, text, stamp=stamp)


EVENTS = Event.schema.constants
FREQUENT = {EVENTS[name] for name in ("SKIPPED", "OVERWRITTEN", "HOST_STALL")}


class Reporter:
    """Reports to people, or to the process that started the service.

    Args:
        sender: of messages to that process; None for people.
        side, robot: of the service.
        lines: JSON lines that replace the lines for people, if any.
    """

    def __init__(
        self,
        sender: MessageSender | None,
        side: str,
        robot: str,
        lines: JsonLines | None = None,
    ) -> None:
        self._sender, self._side, self._robot = sender, side, robot
        self._lines = lines
        self._session: dict[str, int | str] = {}
        self._conditions: tuple[str, ...] = ()  # names that the controller gives
        self._joints: tuple[str, ...] = ()
        self._period_s = 0.0
        self._began: dict[int, int | None] = {}  # conditions: first tick; None once it has ended

    def say(self, text: str, kind: NoteKind = "said") -> None:
        """Report one line of a kind."""
        self._tell(StatusMessage(f"{self._side}: {text}", kind))
        if self._lines is not None:
            grade, name = OF_NEWS[kind]
            self._lines.write(grade, name, text, more=self._session)

    def sum_up(self, text: str) -> None:
        """The last line, for machines alone: people get a table."""
        if self._lines is not None:
            self._lines.write("info", "summary", text, more=self._session)

    def description(self, record: Record) -> None:
        """Learn the names of the joints, and the period."""
        description = RobotDescription.from_json(record.payload)
        self._joints, self._period_s = description.joint_names, description.period_s

    def session(self, record: Record) -> None:
        """Learn what the following events are about."""
        session = json.loads(record.payload)
        self._conditions = tuple(session.get("conditions", ()))
        self._session = {"session": str(session["session_id"])}
        self._began.clear()

    def event(self, record: Record) -> None:
        """One line for people; of a condition, when it holds for the first time, and its end."""
        event = Event()
        event.load(record.payload)
        if event.kind in FREQUENT:
            return  # hundreds on a busy machine; they are counted, and stand in the log
        name = event_name(event.kind, event.detail)
        words = in_words(event.kind, event.detail, self._joints, self._conditions)
        if event.kind in CONDITIONS:
            since, began = self._began.get(event.detail), event.kind == EVENTS["CONDITION_BEGAN"]
            if event.detail in self._began and (began or since is None):
                return  # it may come and go; the log has it all
            self._began[event.detail] = event.tick if began else None
            if since is not None:
                words += f", after {(event.tick - since) * self._period_s:.3f} s"
        what = f"{name} ({words})" if words else name
        if self._side == "controller" and event.kind == EVENTS["SAFE_STOP"]:
            stopped = stop_words(STOP_REASONS.get(event.detail))
            what = f"robot {self._robot!r}: {stopped}; it waits to be recovered"
        text = f"{self._side}: tick {event.tick}: {what}"
        self._tell(LoopEvent(text, name, is_routine(event.kind, event.detail)))
        if self._lines is not None:
            self._lines.write(
                severity(event.kind, event.detail),
                EVENT_NAMES.get(event.kind, str(event.kind)),
                what,
                stamp=record.stamp,
                more={**self._session, "tick": event.tick, "detail": event.detail},
            )

    def _tell(self, message: StatusMessage | LoopEvent) -> None:
        sent = self._sender is not None and self._sender.send(message)
        if not sent and self._lines is None:
            to_people(message.text)
