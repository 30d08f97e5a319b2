"""`hoap3 record`: listen to a robot from outside, and write what it and its controller say."""

from __future__ import annotations

import json
import os
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hoap3.protocol.answers import parse_description
from hoap3.protocol.config.settings import LogSettings
from hoap3.protocol.errors import Hoap3Error, LinkError, UsageError
from hoap3.protocol.runtime.shm_ring import Kind, Record, Ring
from hoap3.tools.logs.log_writer import LogWriter
from hoap3.tools.machine.machine import versions
from hoap3.tools.machine.processes import StopFlag
from hoap3.tools.services.client import check_name, client_settings, unanswered
from hoap3.tools.services.observer import REPAIR
from hoap3.tools.services.services import run_folder

POLL_S = 0.005


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
    from hoap3.protocol.link.zenoh_session import ask, check_unique, open_session, session_name

    check_name(robot)
    stop = StopFlag()
    ring, counts = Ring(), Counter[Kind]()
    settings = client_settings(endpoint)
    with open_session(settings, robot) as session:
        check_unique(session, robot)
        data = ask(session, robot, "description", session_name(settings, f"recorder-{os.getpid()}"))
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
        subscribers = _subscribe(session, robot, ring)
        report(f"recording robot {robot!r} into {folder}")
        end = None if duration is None else time.monotonic() + duration

        def write_what_was_heard() -> None:
            waiting = ring.slots - ring.free  # not what comes meanwhile: stop() is asked first
            for record in ring.read() if waiting else ():
                gap = record.kind == Kind.GAP
                waiting -= not gap  # which takes no slot
                counts[record.kind] += json.loads(record.payload)["dropped"] if gap else 1
                writer.add(record)
                if not waiting:
                    break

        try:
            try:
                while not stop() and (end is None or time.monotonic() < end):
                    write_what_was_heard()
                    writer.flush_due(time.monotonic_ns())
                    time.sleep(POLL_S)
                for subscriber in subscribers:
                    subscriber.undeclare()
                write_what_was_heard()
                last = ring.dropped - counts[Kind.GAP]  # behind the last record that was kept
                if last:
                    writer.add(Record(Kind.GAP, time.monotonic_ns(), b'{"dropped": %d}' % last))
            except (OSError, UsageError):
                writer.abandon()
                raise
            finally:
                writer.close()
        except (OSError, UsageError) as error:
            why = (isinstance(error, OSError) and error.strerror) or str(error)
            raise Hoap3Error(f"the log in {folder} is not whole: {why}; {REPAIR}") from error
    if ring.dropped:
        report(f"the log has gaps: {ring.dropped} records came faster than they were written")
    return {
        "states": counts[Kind.STATE],
        "setpoints": counts[Kind.SETPOINT],
        "events": counts[Kind.EVENT],
        "dropped": ring.dropped,
        "log": str(folder),
    }


def _subscribe(session: Any, robot: str, ring: Ring) -> list[Any]:
    """Have everything that a robot and its controller publish written to a ring."""
    from hoap3.protocol.link.zenoh_session import key, state_key

    one_at_a_time = threading.Lock()  # Zenoh calls from several threads

    def writer(kind: Kind) -> Callable[[Any], None]:
        def write(sample: Any) -> None:
            with one_at_a_time:
                ring.write(kind, time.monotonic_ns(), sample.payload.to_bytes())

        return write

    topics = {
        state_key(robot): Kind.STATE,
        key(robot, "setpoint/**"): Kind.SETPOINT,
        key(robot, "events"): Kind.EVENT,
    }
    return [session.declare_subscriber(topic, writer(kind)) for topic, kind in topics.items()]
