"""Figures of a service for Prometheus, served by its observer: the extra `hoap3[metrics]`.

They are made when they are requested, from what the observer counts anyway.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily
from prometheus_client.metrics_core import Metric

from hoap3.protocol.messages import Event
from hoap3.protocol.runtime.deadlines import Durations
from hoap3.protocol.runtime.shm_ring import Kind, Record, Ring
from hoap3.robot_emulator.setpoint_validator import REJECTION_KINDS
from hoap3.tools.analysis.event_words import event_name
from hoap3.tools.analysis.output import bad_connections
from hoap3.tools.machine.stalls import OutsideStalls
from hoap3.tools.services.run_statistics import RunStatistics
from hoap3.tools.services.systemd_notify import MODES

BUCKETS_US = (
    *(50, 75, 100, 150, 200, 300, 400, 500, 600, 700, 800, 900, 1000, 1250, 1500),
    *(2000, 5000, 10_000, 20_000, 50_000, 100_000, 1_000_000),
)
"""Of round trips and wake-ups, close together where the deadline of a 1 kHz loop stands."""
ACCEPT_PAUSE_S = 0.1  # until a client is accepted that could not be
IDLE_S = 10.0  # without a request, after which a connection is closed
Figure = float | tuple[list[tuple[str, float]], float]
"""A number, or what `histogram` returns."""
Figures = Figure | Mapping[str, Figure]
STAGE_BUCKETS_US = (1, 2, 5, 10, 20, 50, 100, 200, 300, 500, 700, 1000, 2000, 5000, 20_000)


@dataclass
class LogFacts:
    """What became of the log so far.

    Attributes:
        folder: of it; None where nothing is recorded.
        size: bytes that it takes.
        lost: whether it is not written any more.
    """

    folder: Path | None
    size: Callable[[], int]
    lost: Callable[[], bool]


@dataclass(eq=False)
class ServiceMetrics:
    """What Prometheus is told of one service; a collector of its client library.

    Attributes:
        side, robot: labels of every figure.
        ring: between loop and observer.
        log: what became of it.
        statistics, stalls: of a robot; None of a controller.
        certificate_ends: Unix time [s] of that which it shows; None where it shows none.
    """

    side: str
    robot: str
    ring: Ring
    log: LogFacts
    statistics: RunStatistics | None = None
    stalls: OutsideStalls | None = None
    certificate_ends: float | None = None
    _events: Counter[str] = field(default_factory=Counter)
    _records: Counter[Kind] = field(default_factory=Counter)
    _met: int = 0

    def add(self, record: Record) -> None:
        """Take a record of the loop, or one of the observer."""
        self._records[record.kind] += 1
        if record.kind == Kind.EVENT:
            kind, detail = Event.scalars(record.payload, "kind", "detail")
            self._events[event_name(kind, detail)] += 1

    def collect(self) -> Iterator[Metric]:
        """Every figure, as it is now; called in a thread of the server."""
        if self.statistics is not None:
            yield from self._robot(self.statistics)
        records = dict(self._records)
        states, setpoints = records.get(Kind.STATE, 0), records.get(Kind.SETPOINT, 0)
        yield self._counter("states", "States published, or heard by a controller", states)
        yield self._counter("setpoints", "Setpoints arrived, or sent by a controller", setpoints)
        yield self._counter("events", "Events, by kind", dict(self._events), "kind")
        yield self._counter("dropped_records", "Records not taken in time", self.ring.dropped)
        if self.certificate_ends is not None:
            words = "Unix time at which the certificate that it shows ends"
            yield self._gauge("certificate_expiry_seconds", words, self.certificate_ends)
        yield from self._log()

    def _robot(self, statistics: RunStatistics) -> Iterator[Metric]:
        state = statistics.state
        if not state:
            return
        missed = state["late"] + state["lost"]
        pending = 2 + statistics.delay_ticks  # not judged yet
        self._met = max(self._met, statistics.asked - pending - missed)
        yield self._counter("deadlines_met", "Ticks answered in time", self._met)
        yield self._counter("deadlines_missed", "Ticks answered late or never", missed)
        yield self._counter("deadlines_late", "Ticks answered late", state["late"])
        yield self._counter("ticks_skipped", "Periods without a wake-up", state["skipped"])
        for name in ("duplicate", "out_of_order"):
            yield self._counter(f"setpoints_{name}", f"Setpoints {name}", state[name])
        rejected = dict(zip(REJECTION_KINDS, self.ring.counts(len(REJECTION_KINDS)), strict=True))
        yield self._counter("setpoints_rejected", "Setpoints refused", rejected, "reason")
        rate = state["success_rate"]
        yield self._gauge("success_rate", "In time, of the last 100 ticks that asked", rate)
        mode = {name: int(state["mode"] == value) for value, name in MODES.items()}
        yield self._gauge("mode", "1 for the mode that the robot is in", mode, "mode")
        yield self._gauge("authority_epoch", "Epoch that is obeyed; 0: none", state["epoch"])
        yield from self._durations(statistics)
        if self.stalls is not None and self.stalls.known:
            n, seconds = self.stalls.n, self.stalls.total_ns / 1e9
            yield self._counter("host_stalls", "Stalls of the host while it moved", n)
            yield self._counter("host_stall_seconds", "Their time", seconds)
            outside = self.stalls.outside
            yield self._counter("misses_outside_stalls", "Misses that no stall excuses", outside)

    def _durations(self, statistics: RunStatistics) -> Iterator[Metric]:
        rtt, wakeup = (histogram(d, BUCKETS_US) for d in (statistics.rtt, statistics.wakeup))
        yield self._filled(HistogramMetricFamily, "rtt_seconds", "Round trip", rtt, "")
        words = "Wake-up after its time"
        yield self._filled(HistogramMetricFamily, "wakeup_seconds", words, wakeup, "")
        stages = {name: histogram(d, STAGE_BUCKETS_US) for name, d in statistics.stages.items()}
        words = "Parts of the round trip"
        yield self._filled(HistogramMetricFamily, "stage_seconds", words, stages, "stage")

    def _log(self) -> Iterator[Metric]:
        if self.log.folder is None:
            return
        yield self._gauge("log_bytes", "Size of this log", self.log.size())
        yield self._gauge("log_lost", "1 where it is not written any more", self.log.lost())
        try:
            space = os.statvfs(self.log.folder)
        except OSError:
            return  # the folder is gone, which `log_lost` tells
        free = space.f_bavail * space.f_frsize
        yield self._gauge("log_free_bytes", "Room where the log goes", free)

    def _counter(self, name: str, words: str, value: Figures, label: str = "") -> Metric:
        return self._filled(CounterMetricFamily, name, words, value, label)

    def _gauge(self, name: str, words: str, value: Figures, label: str = "") -> Metric:
        return self._filled(GaugeMetricFamily, name, words, value, label)

    def _filled(
        self, kind: Callable[..., Any], name: str, words: str, value: Figures, label: str
    ) -> Metric:
        """A figure, or one for each value of a label."""
        labels = ("side", "robot", *([label] if label else ()))
        family: Any = kind(f"hoap3_{name}", words, labels=labels)
        figures = value if isinstance(value, Mapping) else {None: value}
        for key, figure in figures.items():
            places = (self.side, self.robot, *([] if key is None else [key]))
            family.add_metric(places, *(figure if isinstance(figure, tuple) else (figure,)))
        made: Metric = family
        return made


def histogram(
    durations: Durations, buckets_us: Iterable[int]
) -> tuple[list[tuple[str, float]], float]:
    """Cumulative counts by upper bound [s], and the sum [s], as Prometheus wants them."""
    bounds = list(buckets_us)
    counts = durations.up_to([bound * 1000 for bound in bounds])
    found = [(f"{bound / 1e6:g}", float(n)) for bound, n in zip(bounds, counts, strict=True)]
    return [*found, ("+Inf", float(max(durations.n, *counts)))], durations.total / 1e9


class MetricsServer:
    """Serves figures at `http://HOST:PORT/metrics` until the process ends.

    Args:
        metrics: that are collected.
        host, port: where it listens; port 0: a free one.
        pause: takes how long to wait [s] before a client is accepted that could not be.

    Raises:
        OSError: the port is taken, or the address is none of this machine.
    """

    def __init__(
        self,
        metrics: ServiceMetrics,
        host: str,
        port: int,
        pause: Callable[[float], object] = time.sleep,
    ) -> None:
        registry = CollectorRegistry()
        registry.register(metrics)
        self._server, _ = start_http_server(port, addr=host, registry=registry)
        accept = self._server.get_request

        def accepted() -> Any:
            try:
                return accept()
            except OSError:  # no descriptor is left: the client waits, and would be tried at once
                pause(ACCEPT_PAUSE_S)
                raise

        self._server.get_request = accepted  # type: ignore[method-assign]
        logger = bad_connections("metrics")
        self._server.handle_error = lambda *_: logger.exception("")  # type: ignore[method-assign]
        kind: Any = self._server.RequestHandlerClass
        self._server.RequestHandlerClass = type(kind.__name__, (kind,), {"timeout": IDLE_S})
        self.url = f"http://{host}:{self._server.server_port}/metrics"

    def close(self) -> None:
        """Serve no more."""
        self._server.shutdown()
        self._server.server_close()
