"""The observer: a process beside each service that records, counts and reports.

It reads the ring that the service's loop writes, at ordinary priority, so that no log, disk or
terminal can ever hold up the loop. It ends when the service closes the ring, or dies. Where the log
cannot be written any more, or the observer itself dies, the service is told at once.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.shm_ring import Kind, Record, Ring
from hoap3.protocol.stop_reasons import STOP_REASONS, stop_words
from hoap3.tools.machine.processes import Child, Lifeline, read_order, to_people
from hoap3.tools.machine.stalls import PRIORITY, StallMonitor
from hoap3.tools.services.stall_attribution import OutsideStalls
from hoap3.tools.show.certificate_count import CertificateCount
from hoap3.tools.show.event_words import CONDITIONS, event_name, in_words, is_routine

if TYPE_CHECKING:
    from hoap3.tools.logs.log_writer import LogWriter

POLL_S = 0.005
LIVE_S = 0.25
DRAIN_S = 30.0  # for what is left to be written at the end
END_S = 5.0  # for the end of a process that has nothing left to do
REPAIR = "`hoap3 record --repair` mends what there is"
_EVENTS = Event.schema.constants
UNWATCHED = f", which takes SCHED_FIFO {PRIORITY} there: `ulimit -r {PRIORITY}`, or root"
_FREQUENT = {_EVENTS[name] for name in ("SKIPPED", "OVERWRITTEN", "HOST_STALL")}


class ObserverHandle:
    """The handle that a service has of its observer.

    Args:
        order: `side`, "robot" or "controller"; `robot`, its name; `directory`, folder of this run,
            or None to record nothing; `attachments`, files for the log, by name; `metadata`, facts
            for the log, by group; `limits`, bytes of the whole log, and of one file; `period_ns`
            of the robot; `lockstep`, whether stamps are virtual; `watch`, CPUs whose stalls are
            noted and count as the host's; `keep_awake`, whether these are kept from falling
            asleep; `status_fd`, open file that takes a JSON line for every piece of news, or None
            for people.
        report: takes what became of the log, once, when it is lost; called in a thread.

    Attributes:
        final: what it told at its end: `paths`, `dropped`, number of `states`, of the robot its
            `summary`, of a controller `certificates` and its own summary as `outcome`. Empty where
            it died.
        lost: why the log is not whole, for people; "" if it is.

    Raises:
        OSError: its process cannot be started.
    """

    def __init__(self, order: Mapping[str, Any], report: Callable[[str], None]) -> None:
        self.ring = Ring()
        self.final: dict[str, Any] = {}
        self.lost = ""
        self._side, self._report = order["side"], report
        self._late = False
        reader, last_words = os.pipe()
        whole = json.dumps({**order, "fd": self.ring.fd, "last_words_fd": last_words})
        status = [] if order["status_fd"] is None else [order["status_fd"]]
        fds = [self.ring.fd, last_words, *status]
        try:
            self._process = Child(["hoap3.tools.services.observer"], whole, fds)
        except BaseException:
            os.close(reader)
            os.close(self.ring.fd)
            raise
        finally:
            os.close(last_words)
        self._listener = threading.Thread(target=self._listen, args=(reader,), name="observer")
        self._listener.daemon = True
        self._listener.start()

    def alive(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    def close(self) -> bool:
        """Say that nothing follows, and wait until all of it is on disk; False where it is not."""
        self.ring.close()
        self._listener.join(DRAIN_S)
        self._late = self._listener.is_alive()
        self._process.end(0.0 if self._late else END_S)
        self._listener.join(END_S)
        os.close(self.ring.fd)
        return not self.lost

    def _listen(self, reader: int) -> None:
        """Take what the observer says until it ends; it sleeps in between."""
        with os.fdopen(reader) as stream:
            for line in stream:
                try:
                    said = json.loads(line)
                except ValueError:
                    break  # it was killed in the midst of it
                if "lost" in said:
                    self._lose(said["lost"])
                else:
                    self.final = said
        if not self.final:
            code = self._process.end(END_S)
            why = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
            self._lose(f"its observer {f'took longer than {DRAIN_S:g} s' if self._late else why}")

    def _lose(self, why: str) -> None:
        if not self.lost:
            self.lost = f"the {self._side}'s log is not whole: {why}; {REPAIR}"
            self._report(self.lost)


class _Reporter:
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
        if event.kind in _FREQUENT:
            return  # hundreds on a busy machine; they are counted, and stand in the log
        if event.kind in CONDITIONS:
            if event.detail in self._told:
                return  # it may come and go; the log has it all
            self._told.add(event.detail)
        name = event_name(event.kind, event.detail)
        words = in_words(event.kind, event.detail, (), self._conditions)
        what = f"{name} ({words})" if words else name
        if self._side == "controller" and event.kind == _EVENTS["SAFE_STOP"]:
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


def main() -> int:
    """Run until the ring ends; the order comes on standard input."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    # The service ends us, after its last record. Ignored, it would be so in the monitors, too.
    signal.signal(signal.SIGTERM, lambda *_: None)
    parent, order = Lifeline(), read_order()
    ring = Ring(order["fd"])
    keeper = _LogKeeper(order)
    due = time.monotonic() + LIVE_S
    while True:
        ended = ring.closed or parent.cut()  # asked before the last reading
        for record in ring.read():
            keeper.take(record)
        keeper.look_for_stalls()
        if ended:
            break
        now = time.monotonic()
        if now >= due:
            due = now + LIVE_S
            keeper.tell()
        time.sleep(POLL_S)
    keeper.end(ring.dropped)
    return 0


class _LogKeeper:
    """What an observer does with what it sees: it writes, counts and tells."""

    def __init__(self, order: dict[str, Any]) -> None:
        from hoap3.tools.logs.log_writer import LogWriter
        from hoap3.tools.services.run_statistics import RunStatistics

        self._last_words_fd = order["last_words_fd"]
        self._writer: LogWriter | None = None
        self._paths: list[Path] = []
        if order["directory"]:
            cap_bytes, file_bytes = order["limits"]
            try:
                self._writer = LogWriter(
                    Path(order["directory"]),
                    robot=order["robot"],
                    side=order["side"],
                    attachments={
                        name: text.encode() for name, text in order["attachments"].items()
                    },
                    metadata=order["metadata"],
                    cap_bytes=cap_bytes,
                    file_bytes=file_bytes,
                )
            except (OSError, UsageError) as error:
                self._lose(error)
        self._monitor = StallMonitor(order["watch"], keep_awake=order["keep_awake"])
        self._stalls = OutsideStalls(self._monitor.logs)
        self._said_watched = False
        self._keep_awake = bool(order["keep_awake"])
        self._unwatched: set[int] = set()
        self._obtained: list[str] = []
        self._is_robot = order["side"] == "robot"
        self._statistics = RunStatistics(
            order["period_ns"], self._stalls, timing=not order["lockstep"]
        )
        self._certificates = CertificateCount()
        self._outcome: dict[str, Any] | None = None
        self._reporter = _Reporter(order["status_fd"], order["side"], order["robot"])
        self._states = 0

    def take(self, record: Record) -> None:
        """A record of the loop, or one of our own."""
        if self._writer is not None:
            try:
                self._writer.add(record)
            except OSError as error:
                self._lose(error)
        if self._is_robot:
            self._statistics.add(record)
        else:
            self._certificates.add(record)
            if record.kind == Kind.SUMMARY:
                self._outcome = json.loads(record.payload)
        self._states += record.kind == Kind.STATE
        if record.kind == Kind.EVENT:
            self._reporter.event(record)
        elif record.kind == Kind.SESSION:
            self._reporter.session(record)

    def look_for_stalls(self) -> None:
        """Record what the monitors have noted, and let old chunks go to the disk."""
        if self._stalls.known and not self._said_watched:
            self._said_watched = True
            for cpu, log in self._monitor.logs.items():
                self._obtained.append(f"CPU {cpu}: " + ("kept awake" if log.awake else "may sleep"))
                as_asked = log.awake or not self._keep_awake
                self._reporter.say(self._obtained[-1], "detail" if as_asked else "said")
                self.take(_event("STALLS_WATCHED", time.monotonic_ns(), cpu))
        reasons = dict.fromkeys(self._monitor.refused(), UNWATCHED)
        reasons |= dict.fromkeys(self._monitor.killed(), " any more, the monitor died")
        for cpu in reasons.keys() - self._unwatched:
            self._unwatched.add(cpu)
            self._obtained.append(f"CPU {cpu}: stalls are not watched{reasons[cpu]}")
            self._reporter.say(self._obtained[-1])
        for _, stall in self._stalls.take():
            self.take(_event("HOST_STALL", stall.start, stall.end - stall.start))
        self._stalls.attribute(time.monotonic_ns())
        if self._writer is not None:
            try:
                self._writer.flush_due(time.monotonic_ns())
            except OSError as error:
                self._lose(error)

    def tell(self) -> None:
        """What people watch."""
        if self._is_robot:
            self._reporter.send("live", self._statistics.live())

    def end(self, dropped: int) -> None:
        """Finish the log and tell what became of it."""
        self._monitor.stop()
        if self._writer is not None:
            if dropped:
                self._reporter.say(
                    f"the log has gaps: {dropped} records came faster than they were written"
                )
            try:
                self._writer.close()
            except OSError as error:
                self._lose(error)
            else:
                self._paths = self._writer.paths
        paths = [str(path) for path in self._paths]
        final: dict[str, Any] = {"paths": paths, "dropped": dropped, "states": self._states}
        if self._is_robot:
            summary = self._statistics.summary()
            summary["realtime"] = [*summary["realtime"], *self._obtained]
            final["summary"] = {**summary, "dropped_records": dropped}
        else:
            final["certificates"] = self._certificates.figures()
            final["outcome"] = self._outcome
        self._reporter.send("final", final)
        self._tell_service(final)

    def _lose(self, error: Exception) -> None:
        """The log ends here: say so at once, and go on counting."""
        why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        self._tell_service({"lost": why})
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.abandon()
            self._paths = writer.paths

    def _tell_service(self, content: dict[str, Any]) -> None:
        with suppress(BrokenPipeError), open(self._last_words_fd, "w", closefd=False) as stream:
            stream.write(json.dumps(content) + "\n")  # a broken pipe: it is gone


def _event(kind: str, stamp: int, detail: int) -> Record:
    event = Event()
    event.kind, event.stamp, event.detail = _EVENTS[kind], stamp, detail
    return Record(Kind.EVENT, stamp, event.dump())


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (Hoap3Error, OSError) as error:
        sys.exit(f"error: the observer ends: {error}")
