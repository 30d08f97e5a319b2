"""The observer: a process beside each service that records, counts and reports.

It reads the ring that the service's loop writes, at ordinary priority, so that no log, disk or
terminal can ever hold up the loop. It ends when the service closes the ring, or dies.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, TextIO

from protocol.errors import Hoap3Error
from protocol.messages import Event
from protocol.ring import Kind, Record, Ring
from tools.processes import to_people

POLL_S = 0.005
LIVE_S = 0.25
DRAIN_S = 30.0
_FREQUENT = {Event.schema.constants[name] for name in ("SKIPPED", "OVERWRITTEN")}


class Observer:
    """The handle that a service has of its observer.

    Args:
        side: "robot" or "controller".
        robot: name of the robot.
        directory: folder of this run, or None to record nothing.
        attachments: files for the log, by name.
        metadata: facts for the log, by group.
        limits: bytes of the whole log, and of one file.
        period_ns: of the robot.
        lockstep: whether stamps are virtual.
        status_fd: open file that takes a JSON line for every piece of news, or None for people.
    """

    def __init__(
        self,
        *,
        side: str,
        robot: str,
        directory: Path | None,
        attachments: dict[str, str],
        metadata: dict[str, dict[str, str]],
        limits: tuple[int, int],
        period_ns: int,
        lockstep: bool,
        status_fd: int | None = None,
    ) -> None:
        self.ring = Ring()
        order = {
            "fd": self.ring.fd,
            "side": side,
            "robot": robot,
            "directory": str(directory) if directory else None,
            "attachments": attachments,
            "metadata": metadata,
            "limits": limits,
            "period_ns": period_ns,
            "lockstep": lockstep,
            "status_fd": status_fd,
            "parent": os.getpid(),
        }
        fds = [self.ring.fd] + ([status_fd] if status_fd is not None else [])
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "tools.observer"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            pass_fds=fds,
            start_new_session=True,  # a Ctrl-C at the terminal is the service's business
        )
        if self._process.stdin is None:
            raise Hoap3Error("the observer process has no standard input")
        self._process.stdin.write(json.dumps(order).encode())
        self._process.stdin.close()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def alive(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    def close(self) -> bool:
        """Say that nothing follows, and wait until all of it is on disk; False where it is not."""
        self.ring.close()
        try:
            return self._process.wait(timeout=DRAIN_S) == 0
        except subprocess.TimeoutExpired:
            self._process.kill()
            return False
        finally:
            os.close(self.ring.fd)


class _Reporter:
    """Tells people, or the process that asked for it, what happens."""

    def __init__(self, status_fd: int | None, side: str) -> None:
        self._status: TextIO | None = None if status_fd is None else os.fdopen(status_fd, "w")
        self._side = side
        self._kinds = {
            value: name
            for name, value in Event.schema.constants.items()
            if not name.startswith(("REASON", "WIRE"))
        }
        self._reasons = {
            value: name.removeprefix("REASON_").lower().replace("_", " ")
            for name, value in Event.schema.constants.items()
            if name.startswith("REASON")
        }

    def send(self, news: str, content: dict[str, Any]) -> None:
        """One JSON line, where somebody reads them."""
        if self._status is None:
            return
        try:
            self._status.write(json.dumps({"news": news, "side": self._side, **content}) + "\n")
            self._status.flush()
        except BrokenPipeError:
            self._status = None  # whoever asked is gone; the log goes on

    def say(self, text: str) -> None:
        """One line for people."""
        self._tell("said", {"text": f"{self._side}: {text}"})

    def event(self, record: Record) -> None:
        """One line for people."""
        event = Event()
        event.load(record.payload)
        if event.kind in _FREQUENT:
            return  # hundreds on a busy machine; they are counted, and stand in the log
        name = self._kinds.get(event.kind, str(event.kind)).lower().replace("_", " ")
        detail = str(event.detail)
        if event.kind == Event.schema.constants["SAFE_STOP"]:
            detail = self._reasons.get(event.detail, detail)
        text = f"{self._side}: tick {event.tick}: {name} ({detail})"
        self._tell(
            "event", {"text": text, "kind": name, "tick": event.tick, "detail": event.detail}
        )

    def _tell(self, news: str, content: dict[str, Any]) -> None:
        if self._status is None:
            to_people(content["text"])
        self.send(news, content)


def main() -> int:
    """Run until the ring ends; the order comes on standard input."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the service ends us, after its last record
    order = json.load(sys.stdin)
    from tools.log_writer import LogWriter  # noqa: PLC0415 - after the signals are ignored
    from tools.statistics import RunStatistics  # noqa: PLC0415

    ring = Ring(order["fd"])
    writer = None
    if order["directory"]:
        cap_bytes, file_bytes = order["limits"]
        writer = LogWriter(
            Path(order["directory"]),
            robot=order["robot"],
            side=order["side"],
            attachments={name: text.encode() for name, text in order["attachments"].items()},
            metadata=order["metadata"],
            cap_bytes=cap_bytes,
            file_bytes=file_bytes,
        )
    statistics = RunStatistics(order["period_ns"], timing=not order["lockstep"])
    reporter = _Reporter(order["status_fd"], order["side"])
    is_robot = order["side"] == "robot"
    due = time.monotonic() + LIVE_S
    while True:
        ended = ring.closed or os.getppid() != order["parent"]  # asked before the last reading
        for record in ring.read():
            if writer is not None:
                writer.add(record)
            if is_robot:
                statistics.add(record)
            if record.kind == Kind.EVENT:
                reporter.event(record)
        if writer is not None:
            writer.flush_due(time.monotonic_ns())
        if ended:
            break
        now = time.monotonic()
        if is_robot and now >= due:
            due = now + LIVE_S
            reporter.send("live", statistics.live())
        time.sleep(POLL_S)
    if writer is not None:
        writer.close()
    paths = [str(path) for path in writer.paths] if writer is not None else []
    final = {"paths": paths, "dropped": ring.dropped}
    if writer is not None and ring.dropped:
        reporter.say(f"the log has gaps: {ring.dropped} records came faster than they were written")
    if is_robot:
        final["summary"] = statistics.summary()
    reporter.send("final", final)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (Hoap3Error, OSError) as error:
        sys.exit(f"error: the observer ends: {error}")
