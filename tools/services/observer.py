"""The observer: a process beside each service that records, counts and reports.

It reads the ring that the service's loop writes, at ordinary priority, so that no log, disk or
terminal can ever hold up the loop. It ends when the service closes the ring, or dies. Where the log
cannot be written any more, or the observer itself dies, the service is told at once.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hoap3.protocol.config.endpoints import is_loopback, zone_fault
from hoap3.protocol.config.settings import MetricsSettings
from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.notes import Unserved
from hoap3.protocol.runtime.shm_ring import Kind, Record, Ring
from hoap3.tools.analysis.certificates import CertificateCount
from hoap3.tools.machine.processes import (
    Child,
    Lifeline,
    give_back_large_blocks,
    read_order,
    to_people,
)
from hoap3.tools.machine.stalls import PRIORITY, OutsideStalls, StallMonitor
from hoap3.tools.services.messages import (
    LiveFigures,
    LogLost,
    MessageSender,
    MetricsLost,
    ObserverConfig,
    ObserverResult,
)
from hoap3.tools.services.reporter import EVENTS, JsonLines, Reporter, facts_of
from hoap3.tools.services.systemd_notify import PINGS, Watchdog, status_words

if TYPE_CHECKING:
    from hoap3.tools.logs.log_writer import LogWriter
    from hoap3.tools.services.metrics import ServiceMetrics

POLL_S = 0.005
LIVE_S = 0.25
PING_S = 0.05  # between two looks at the loop for systemd
DRAIN_S = 30.0  # for what is left to be written at the end
END_S = 5.0  # for the end of a process that has nothing left to do
REPAIR = "`hoap3 record --repair` repairs what is left"
UNWATCHED = f", which takes SCHED_FIFO {PRIORITY} there: `ulimit -r {PRIORITY}`, or root"


class ObserverHandle:
    """Starts the observer as a child process; lives in the process of the service.

    Args:
        config: of the observer.
        report: takes what became of the log, once, when it is lost, and of metrics that cannot be
            served; called in a thread.

    Attributes:
        result: its last message; None where it died.
        lost: why the log is not whole, for people; "" if it is.
        unserved: why metrics are not served, for people; "" if they are, or nobody wants them.

    Raises:
        OSError: its process cannot be started.
    """

    def __init__(self, config: ObserverConfig, report: Callable[[str], None]) -> None:
        self.ring = Ring()
        self.result: ObserverResult | None = None
        self.lost = self.unserved = ""
        self._side, self._report, self._notify = config.side, report, config.notify
        self._late, self._ended = False, threading.Event()
        reader, writer = os.pipe()
        status = [] if config.status_fd is None else [config.status_fd]
        try:
            self._process = Child(
                ["hoap3.tools.services.observer"],
                (config, self.ring.fd, writer),
                [self.ring.fd, writer, *status],
                stdout=None if config.json_lines else subprocess.DEVNULL,
            )
        except BaseException:
            os.close(reader)
            os.close(self.ring.fd)
            raise
        finally:
            os.close(writer)
        self._listener = threading.Thread(target=self._listen, args=(reader,), name="observer")
        self._listener.daemon = True
        self._listener.start()

    def alive(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    def watching(self, should_stop: Callable[[], bool]) -> Callable[[], bool]:
        """`should_stop`, but each call also counts as a sign of life of the loop for systemd."""
        if self._notify is None:
            return should_stop
        beat = self.ring.beat

        def asked() -> bool:
            beat()
            return should_stop()

        return asked

    def close(self) -> bool:
        """Say that nothing follows, and wait until all of it is on disk; False where it is not."""
        self._ended.set()
        self.ring.close()
        self._listener.join(DRAIN_S)
        self._late = self._listener.is_alive()
        self._process.end(0.0 if self._late else END_S)
        self._listener.join(END_S)
        os.close(self.ring.fd)
        return not self.lost

    def _listen(self, reader: int) -> None:
        """Receive messages of the observer until it ends; it sleeps in between."""
        with Connection(reader, writable=False) as pipe, suppress(EOFError, OSError):
            while True:
                self._receive(pipe.recv())
        if self.result is None:
            code = self._process.end(END_S)
            why = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
            self._lose(f"its observer {f'took longer than {DRAIN_S:g} s' if self._late else why}")
            self._stand_in()

    def _receive(self, message: LogLost | MetricsLost | ObserverResult) -> None:
        match message:
            case LogLost():
                self._lose(message.reason, message.errno)
            case MetricsLost():
                self.unserved = f"the {self._side}'s metrics are not served: {message.reason}"
                self._report(Unserved(self.unserved))
            case ObserverResult():
                self.result = message

    def _stand_in(self) -> None:
        """Ping the watchdog in place of an observer that died, until the service ends."""
        if self._notify is None or self._notify.watchdog_s is None:
            return
        watchdog = Watchdog(self._notify, lambda: self.ring.beats, time.monotonic)
        watchdog.look()
        while not self._ended.wait(self._notify.watchdog_s / (2 * PINGS)):
            watchdog.look()
        watchdog.close()

    def _lose(self, why: str, code: int = 0) -> None:
        if not self.lost:
            self.lost = f"the {self._side}'s log is not whole: {why}; {REPAIR}"
            self.ring.lost = code  # whose loop tells the network
            self._report(self.lost)


def main() -> int:
    """Run until the ring ends; the order comes on standard input."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    # The ring ends this process, not SIGTERM. A handler, unlike SIG_IGN, is not inherited by the
    # stall monitors that are started below.
    signal.signal(signal.SIGTERM, lambda *_: None)
    parent = Lifeline()
    config, ring_fd, service_fd = read_order()
    give_back_large_blocks()  # of which each chunk of a log takes some
    ring = Ring(ring_fd)
    keeper = _LogKeeper(config, ring, MessageSender(service_fd))
    watchdog, pinging = None, threading.Event()
    if config.notify is not None:
        watchdog = Watchdog(config.notify, lambda: ring.beats, time.monotonic)
        ping = threading.Thread(target=_ping, args=(watchdog, pinging), daemon=True)
        ping.start()
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
            status = keeper.tell()
            if watchdog is not None:
                watchdog.tell(status)
        time.sleep(POLL_S)
    if watchdog is not None:
        pinging.set()
        ping.join()
        watchdog.stopping()
    keeper.end(ring.dropped)
    return 0


def _ping(watchdog: Watchdog, ended: threading.Event) -> None:
    """Look after the loop in a thread of its own, which no disk and no terminal holds up."""
    while not ended.wait(PING_S):
        watchdog.look()


class _LogKeeper:
    """What an observer does with what it sees: it writes, counts and tells."""

    def __init__(self, config: ObserverConfig, ring: Ring, service: MessageSender) -> None:
        from hoap3.tools.logs.log_writer import LogWriter
        from hoap3.tools.services.run_statistics import RunStatistics

        self._config, self._service = config, service
        self._status = None if config.status_fd is None else MessageSender(config.status_fd)
        lines = JsonLines(facts_of(config.side, config.robot), to_people)
        self._reporter = Reporter(
            self._status, config.side, config.robot, lines if config.json_lines else None
        )
        self._writer: LogWriter | None = None
        self._lost = False
        self._paths: list[Path] = []
        if config.folder is not None:
            attachments = {name: text.encode() for name, text in config.attachments.items()}
            try:
                self._writer = LogWriter(
                    config.folder,
                    robot=config.robot,
                    side=config.side,
                    attachments=attachments,
                    metadata=config.metadata,
                    cap_bytes=config.cap_bytes,
                    file_bytes=config.file_bytes,
                )
            except (OSError, UsageError) as error:
                self._lose(error)
        self._monitor = StallMonitor(config.watch, keep_awake=config.keep_awake)
        self._stalls = OutsideStalls(self._monitor.logs)
        self._said_watched = False
        self._unwatched: set[int] = set()
        self._obtained: list[str] = []
        self._is_robot = config.side == "robot"
        self._statistics = RunStatistics(config.period_ns, self._stalls, timing=not config.lockstep)
        self._certificates = CertificateCount()
        self._outcome: dict[str, Any] | None = None
        self._states = 0
        self._metrics: ServiceMetrics | None = None
        if config.metrics is not None:
            self._serve(config.metrics, ring)

    def _serve(self, settings: MetricsSettings, ring: Ring) -> None:
        """Serve figures to Prometheus; where that cannot be, the service is told."""
        from hoap3.tools.services.metrics import (
            LogFacts,
            MetricsServer,
            ServiceMetrics,
        )

        self._metrics = ServiceMetrics(
            self._config.side,
            self._config.robot,
            ring,
            LogFacts(self._config.folder, self._log_bytes, lambda: self._lost),
            self._statistics if self._is_robot else None,
            self._stalls,
            self._config.certificate_ends,
        )
        host, port = settings.host, settings.port or 0
        try:
            server = MetricsServer(self._metrics, host, port)
        except (OSError, UnicodeError) as error:  # a host that is no name
            fault = zone_fault(host)
            why = ". ".join(fault) if fault else getattr(error, "strerror", None) or str(error)
            self._service.send(MetricsLost(f"{why} ({host}, port {port})"))
            return
        who = "; anyone who can reach that address can read them" if not is_loopback(host) else ""
        self._reporter.say(f"metrics at {server.url}{who}", "said" if who else "routine")

    def _log_bytes(self) -> int:
        """Size of the log."""
        return self._writer.size if self._writer is not None else 0

    def take(self, record: Record) -> None:
        """A record of the loop, or one of our own."""
        if self._writer is not None:
            try:
                self._writer.add(record)
            except (OSError, UsageError) as error:  # a further file may have no place
                self._lose(error)
        if self._metrics is not None:
            self._metrics.add(record)
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
        elif record.kind == Kind.DESCRIPTION:
            self._reporter.description(record)

    def look_for_stalls(self) -> None:
        """Record what the monitors have noted, and let old chunks go to the disk."""
        if self._stalls.known and not self._said_watched:
            self._said_watched = True
            for cpu, log in self._monitor.logs.items():
                self._obtained.append(f"CPU {cpu}: " + ("kept awake" if log.awake else "may sleep"))
                as_asked = log.awake or not self._config.keep_awake
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

    def tell(self) -> str:
        """What people watch; in one line, too."""
        live = self._statistics.live() if self._is_robot else None
        if live is not None and self._status is not None:
            self._status.send(LiveFigures(live))
        return status_words(live, self._states)

    def end(self, dropped: int) -> None:
        """Finish the log and tell what became of it."""
        self._monitor.stop()
        if dropped:
            them = "figures are" if self._writer is None else "the log and figures are"
            self._reporter.say(
                f"{dropped} records came faster than the observer read them; {them} incomplete"
            )
        if self._writer is not None:
            try:
                self._writer.close()
            except OSError as error:
                self._lose(error)
            else:
                self._paths = self._writer.paths
        result = ObserverResult(self._config.side, tuple(self._paths), self._states)
        if self._is_robot:
            figures = self._statistics.figures()
            figures["realtime"] = [*figures["realtime"], *self._obtained]
            figures["dropped_records"] = dropped
            result = replace(result, figures=figures, counts=self._statistics.counts)
        else:
            certificates = self._certificates.figures()
            result = replace(result, certificates=certificates, outcome=self._outcome)
        self._reporter.sum_up(self.tell())
        if self._status is not None:
            self._status.send(result)
        self._service.send(result)

    def _lose(self, error: Exception) -> None:
        """The log ends here: say so at once, and go on counting."""
        why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        cause = error if isinstance(error, OSError) else error.__cause__
        code = cause.errno if isinstance(cause, OSError) else None
        self._lost = True
        self._service.send(LogLost(why, code or 0))
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.abandon()
            self._paths = writer.paths


def _event(kind: str, stamp: int, detail: int) -> Record:
    event = Event()
    event.kind, event.stamp, event.detail = EVENTS[kind], stamp, detail
    return Record(Kind.EVENT, stamp, event.dump())


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (Hoap3Error, OSError) as error:
        sys.exit(f"error: the observer ends: {error}")
