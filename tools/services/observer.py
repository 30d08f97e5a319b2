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
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hoap3.protocol.config.endpoints import is_loopback, zone_fault
from hoap3.protocol.config.settings import STANDARD_OUTPUT
from hoap3.protocol.errors import Hoap3Error, UsageError
from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.notes import Unserved
from hoap3.protocol.runtime.shm_ring import Kind, Record, Ring
from hoap3.tools.machine.large_blocks import give_back_large_blocks
from hoap3.tools.machine.processes import Child, Lifeline, read_order, to_people
from hoap3.tools.machine.sd_notify import NotifySettings
from hoap3.tools.machine.stalls import PRIORITY, StallMonitor
from hoap3.tools.services.monitoring.json_lines import JsonLines, facts_of
from hoap3.tools.services.monitoring.reporter import EVENTS, Reporter
from hoap3.tools.services.monitoring.watchdog import PINGS, Watchdog, status_words
from hoap3.tools.services.stall_attribution import OutsideStalls
from hoap3.tools.show.certificate_count import CertificateCount

if TYPE_CHECKING:
    from hoap3.tools.logs.log_writer import LogWriter
    from hoap3.tools.services.monitoring.metrics import ServiceMetrics

POLL_S = 0.005
LIVE_S = 0.25
PING_S = 0.05  # between two looks at the loop for systemd
DRAIN_S = 30.0  # for what is left to be written at the end
END_S = 5.0  # for the end of a process that has nothing left to do
REPAIR = "`hoap3 record --repair` mends what there is"
UNWATCHED = f", which takes SCHED_FIFO {PRIORITY} there: `ulimit -r {PRIORITY}`, or root"


class ObserverHandle:
    """The handle that a service has of its observer.

    Args:
        order: `side`, "robot" or "controller"; `robot`, its name; `directory`, folder of this run,
            or None to record nothing; `attachments`, files for the log, by name; `metadata`, facts
            for the log, by group; `limits`, bytes of the whole log, and of one file; `period_ns`
            of the robot; `lockstep`, whether stamps are virtual; `json_lines`, the place of what
            it tells as JSON and the size of a file there [bytes], or None; `watch`, CPUs whose
            stalls are noted and count as the host's; `keep_awake`, whether these are kept from
            falling asleep; `status_fd`, open file that takes a JSON line for every piece of news,
            or None for people; `metrics`, `host` and `port` for them, and `certificate_ends`, a
            Unix time or None, or None for no metrics; `notify`, a `NotifySettings` as a mapping
            where systemd listens, or None.
        report: takes what became of the log, once, when it is lost, and of metrics that cannot be
            served; called in a thread.

    Attributes:
        final: what it told at its end: `paths`, `dropped`, number of `states`, of the robot its
            `summary`, of a controller `certificates` and its own summary as `outcome`. Empty where
            it died.
        lost: why the log is not whole, for people; "" if it is.
        unserved: why metrics are not served, for people; "" if they are, or nobody wants them.

    Raises:
        OSError: its process cannot be started.
    """

    def __init__(self, order: Mapping[str, Any], report: Callable[[str], None]) -> None:
        self.ring = Ring()
        self.final: dict[str, Any] = {}
        self.lost = self.unserved = ""
        self._side, self._report = order["side"], report
        self._notify = NotifySettings(**order["notify"]) if order["notify"] else None
        self._late, self._ended = False, threading.Event()
        reader, last_words = os.pipe()
        whole = json.dumps({**order, "fd": self.ring.fd, "last_words_fd": last_words})
        status = [] if order["status_fd"] is None else [order["status_fd"]]
        fds = [self.ring.fd, last_words, *status]
        ours = order["json_lines"] and order["json_lines"]["place"] == STANDARD_OUTPUT
        stdout = None if ours else subprocess.DEVNULL
        try:
            self._process = Child(["hoap3.tools.services.observer"], whole, fds, stdout=stdout)
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

    def watching(self, should_stop: Callable[[], bool]) -> Callable[[], bool]:
        """The same question; to ask it is a sign of life of a loop, where systemd wants some."""
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
        """Take what the observer says until it ends; it sleeps in between."""
        with os.fdopen(reader) as stream:
            for line in stream:
                try:
                    said = json.loads(line)
                except ValueError:
                    break  # it was killed in the midst of it
                if "lost" in said:
                    self._lose(said["lost"], said["errno"])
                elif "unserved" in said:
                    self.unserved = f"the {self._side}'s metrics are not served: {said['unserved']}"
                    self._report(Unserved(self.unserved))
                else:
                    self.final = said
        if not self.final:
            code = self._process.end(END_S)
            why = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
            self._lose(f"its observer {f'took longer than {DRAIN_S:g} s' if self._late else why}")
            self._stand_in()

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
    # The service ends us, after its last record. Ignored, it would be so in the monitors, too.
    signal.signal(signal.SIGTERM, lambda *_: None)
    parent, order = Lifeline(), read_order()
    give_back_large_blocks()  # of which each chunk of a log takes some
    ring = Ring(order["fd"])
    keeper = _LogKeeper(order, ring)
    watchdog, pinging = None, threading.Event()
    if order["notify"]:
        settings = NotifySettings(**order["notify"])
        watchdog = Watchdog(settings, lambda: ring.beats, time.monotonic)
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

    def __init__(self, order: dict[str, Any], ring: Ring) -> None:
        from hoap3.tools.logs.log_writer import LogWriter
        from hoap3.tools.services.run_statistics import RunStatistics

        self._last_words_fd = order["last_words_fd"]
        self._writer: LogWriter | None = None
        self._lost = False
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
        self._reporter = _reporter(order)
        self._states = 0
        self._metrics: ServiceMetrics | None = None
        if order["metrics"]:
            self._serve(order, ring)

    def _serve(self, order: dict[str, Any], ring: Ring) -> None:
        """Serve figures to Prometheus; where that cannot be, the service is told."""
        from hoap3.tools.services.monitoring.metrics import (
            LogFacts,
            MetricsServer,
            ServiceMetrics,
        )

        folder = Path(order["directory"]) if order["directory"] else None
        self._metrics = ServiceMetrics(
            order["side"],
            order["robot"],
            ring,
            LogFacts(folder, self._log_bytes, lambda: self._lost),
            self._statistics if self._is_robot else None,
            self._stalls,
            order["metrics"]["certificate_ends"],
        )
        host, port = order["metrics"]["host"], order["metrics"]["port"]
        try:
            server = MetricsServer(self._metrics, host, port)
        except (OSError, UnicodeError) as error:  # a host that is no name
            fault = zone_fault(host)
            why = ". ".join(fault) if fault else getattr(error, "strerror", None) or str(error)
            self._tell_service({"unserved": f"{why} ({host}, port {port})"})
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

    def tell(self) -> str:
        """What people watch; in one line, too."""
        live = self._statistics.live() if self._is_robot else None
        if live is not None:
            self._reporter.send("live", live)
        return status_words(live, self._states)

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
        self._reporter.sum_up(self.tell())
        self._reporter.send("final", final)
        self._tell_service(final)

    def _lose(self, error: Exception) -> None:
        """The log ends here: say so at once, and go on counting."""
        why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        cause = error if isinstance(error, OSError) else error.__cause__
        code = cause.errno if isinstance(cause, OSError) else None
        self._lost = True
        self._tell_service({"lost": why, "errno": code or 0})
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.abandon()
            self._paths = writer.paths

    def _tell_service(self, content: dict[str, Any]) -> None:
        with suppress(BrokenPipeError), open(self._last_words_fd, "w", closefd=False) as stream:
            stream.write(json.dumps(content) + "\n")  # a broken pipe: it is gone


def _reporter(order: Mapping[str, Any]) -> Reporter:
    """Where this observer says what happens."""
    side, robot, place, lines = order["side"], order["robot"], "", None
    if order["json_lines"]:
        place, most_bytes = order["json_lines"]["place"], order["json_lines"]["most_bytes"]
        lines = JsonLines(place, facts_of(side, robot), to_people, most_bytes)
    quiet = place == STANDARD_OUTPUT
    return Reporter(order["status_fd"], side, robot, lines, quiet=quiet)


def _event(kind: str, stamp: int, detail: int) -> Record:
    event = Event()
    event.kind, event.stamp, event.detail = EVENTS[kind], stamp, detail
    return Record(Kind.EVENT, stamp, event.dump())


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (Hoap3Error, OSError) as error:
        sys.exit(f"error: the observer ends: {error}")
