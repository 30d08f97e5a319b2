"""`hoap3 record`: listen to a robot from outside, and write what it and its controller say."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hoap3.protocol.answers import parse_description
from hoap3.protocol.config.settings import LogSettings
from hoap3.protocol.errors import Hoap3Error, LinkError, UsageError
from hoap3.protocol.runtime.shm_ring import Kind, Record
from hoap3.protocol.wire_versions import upgraded
from hoap3.tools.logs.log_format import MESSAGES
from hoap3.tools.logs.log_writer import LogWriter
from hoap3.tools.machine.machine import versions
from hoap3.tools.machine.processes import StopFlag
from hoap3.tools.services.client import check_name, client_settings, unanswered
from hoap3.tools.services.observer import REPAIR
from hoap3.tools.services.services import run_folder

POLL_S = 0.005
BACKLOG = 4096  # records heard and not yet written: 2 s of a robot and its controller at 1 kHz


class Backlog:
    """What was heard and is not yet written; what comes while it is full is dropped and counted.

    Attributes:
        dropped: records, since the start.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._gap = 0  # records dropped since the last one that was kept
        self._records: deque[Record] = deque()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._records)

    def put(self, record: Record) -> None:
        """Keep a record if there is room, behind a record of kind GAP if some were dropped."""
        with self._lock:
            if len(self._records) >= BACKLOG:
                self.dropped += 1
                self._gap += 1
                return
            if self._gap:
                self._records.append(self._gap_at(record.stamp))
            self._records.append(record)

    def take(self) -> Record:
        """The oldest record, which is removed."""
        return self._records.popleft()

    def end(self, stamp: int) -> None:
        """Nothing more is heard: what was dropped last is a gap, too."""
        with self._lock:
            if self._gap:
                self._records.append(self._gap_at(stamp))

    def _gap_at(self, stamp: int) -> Record:
        gap = Record(Kind.GAP, stamp, b'{"dropped": %d}' % self._gap)
        self._gap = 0
        return gap


def record_robot(
    robot: str,
    endpoint: str,
    out: Path | None,
    duration: float | None,
    report: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Record until stopped, or for `duration` [s]; stamps are this process's monotonic clock.

    Args:
        robot: its name.
        endpoint: where it, or a router, listens.
        out: folder of the log, or None for a new one in logs/.
        duration: of the recording [s], or None.
        report: is told once everything is in place, and at the end of records that were dropped.

    Raises:
        UsageError: that cannot be the name of a robot, or an endpoint.
        LinkError: the robot cannot be reached.
        Hoap3Error: the log was lost while it was written.
        WireError: its description makes no sense.
    """
    import zenoh

    from hoap3.protocol.link.zenoh_session import (
        ask_versions,
        check_unique,
        key,
        open_session,
        session_name,
        state_key,
    )

    check_name(robot)
    stop = StopFlag()
    heard = Backlog()
    counts = {Kind.STATE: 0, Kind.SETPOINT: 0, Kind.EVENT: 0, Kind.GAP: 0}

    def listener(kind: Kind) -> Any:
        def note(sample: zenoh.Sample) -> None:
            payload = sample.payload.to_bytes()
            if kind in MESSAGES:
                payload = upgraded(MESSAGES[kind], payload)
            heard.put(Record(kind, time.monotonic_ns(), payload))

        return note

    settings = client_settings(endpoint)
    with open_session(settings, robot) as session:
        check_unique(session, robot)
        version, data = ask_versions(
            session, robot, "description", session_name(settings, f"recorder-{os.getpid()}")
        )
        if data is None:
            raise LinkError(
                f"no robot called {robot!r} answers at {endpoint}{unanswered(settings)}"
            )
        description = parse_description(data, robot)
        folder = run_folder(LogSettings(), out, ("robot",)) or Path()
        writer = LogWriter(
            folder,
            robot=robot,
            side="robot",
            attachments={},
            metadata={"versions": versions(), "run": {"recorded": "from outside"}},
        )
        writer.add(Record(Kind.DESCRIPTION, time.monotonic_ns(), description.to_json()))
        subscribers = [
            session.declare_subscriber(expression, listener(kind))
            for expression, kind in (
                (state_key(robot, version), Kind.STATE),
                (key(robot, "setpoint/**"), Kind.SETPOINT),
                (key(robot, "events"), Kind.EVENT),
            )
        ]
        report(f"recording robot {robot!r} into {folder}")
        end = None if duration is None else time.monotonic() + duration

        def write_what_was_heard() -> None:
            for _ in range(len(heard)):  # not what comes meanwhile: stop() is asked first
                record = heard.take()
                counts[record.kind] += 1
                writer.add(record)

        try:
            try:
                while not stop() and (end is None or time.monotonic() < end):
                    write_what_was_heard()
                    writer.flush_due(time.monotonic_ns())
                    time.sleep(POLL_S)
                for subscriber in subscribers:
                    subscriber.undeclare()
                heard.end(time.monotonic_ns())
                write_what_was_heard()
            except (OSError, UsageError):
                writer.abandon()
                raise
            finally:
                writer.close()
        except (OSError, UsageError) as error:
            why = (isinstance(error, OSError) and error.strerror) or str(error)
            raise Hoap3Error(f"the log in {folder} is not whole: {why}; {REPAIR}") from error
    if heard.dropped:
        report(f"the log has gaps: {heard.dropped} records came faster than they were written")
    return {
        "states": counts[Kind.STATE],
        "setpoints": counts[Kind.SETPOINT],
        "events": counts[Kind.EVENT],
        "dropped": heard.dropped,
        "log": str(folder),
    }
