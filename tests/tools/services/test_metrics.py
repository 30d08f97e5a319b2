"""Figures for Prometheus are those that the observer counts, in buckets of our own."""

from __future__ import annotations

import errno
import os
import resource
import socket
import struct
import threading
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from prometheus_client.parser import text_string_to_metric_families
from support.certificates.laboratory import laboratory
from support.command_bench import PATIENCE_S, free_port
from support.robot_bench import Bench

from hoap3.protocol.config.endpoints import is_loopback
from hoap3.protocol.config.settings import MetricsSettings, parse
from hoap3.protocol.errors import NotInstalledError
from hoap3.protocol.runtime.deadlines import Durations
from hoap3.protocol.runtime.shm_ring import Ring
from hoap3.protocol.secure.credentials import read_credentials
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.robot_emulator.setpoint_validator import REJECTION_KINDS
from hoap3.tools.analysis import output
from hoap3.tools.machine import machine as extras
from hoap3.tools.services import metrics as metrics_module
from hoap3.tools.services import services
from hoap3.tools.services.messages import ObserverConfig
from hoap3.tools.services.metrics import (
    BUCKETS_US,
    LogFacts,
    MetricsServer,
    ServiceMetrics,
    histogram,
)
from hoap3.tools.services.run_statistics import RunStatistics

LABELS = {"side": "robot", "robot": "arm"}


@pytest.fixture
def ring() -> Iterator[Ring]:
    made = Ring(slots=4)
    yield made
    os.close(made.fd)


def of_a_run(bench: Bench, ring: Ring, folder: Path | None = None) -> ServiceMetrics:
    """What is told of a robot that did what the bench recorded."""
    statistics = RunStatistics(1_000_000)
    log = LogFacts(folder, lambda: 1234, lambda: False)
    metrics = ServiceMetrics("robot", "arm", ring, log, statistics)
    for record in bench.recorder.records:
        metrics.add(record)
        statistics.add(record)
    return metrics


def read(metrics: ServiceMetrics) -> dict[tuple[str, frozenset[tuple[str, str]]], float]:
    """What a scrape gives: name and further labels, and the value."""
    server = MetricsServer(metrics, "127.0.0.1", free_port())
    try:
        with urllib.request.urlopen(server.url) as answer:
            text = answer.read().decode()
    finally:
        server.close()
    found = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            assert LABELS.items() <= sample.labels.items(), sample
            more = frozenset(sample.labels.items() - LABELS.items())
            found[sample.name.removeprefix("hoap3_"), more] = sample.value
    return found


def test_a_scrape_gives_what_was_counted(ring: Ring, tmp_path: Path) -> None:
    lost, late = 30, 40
    bench = Bench(
        lambda tick, answer: [] if tick == lost else [(1_500_000 * (tick == late) or 1000, answer)]
    )
    bench.link.ask("acquire", "alice")
    state = bench.run(200)
    ring.count(REJECTION_KINDS.index("epoch"))
    ring.count(REJECTION_KINDS.index("epoch"))
    metrics = of_a_run(bench, ring, tmp_path)
    found = read(metrics)
    plain = {name: value for (name, more), value in found.items() if not more}
    missed = state.late + state.lost
    assert plain["deadlines_missed_total"] == missed > 0
    assert plain["deadlines_late_total"] == state.late > 0
    assert 0 <= 199 - missed - plain["deadlines_met_total"] <= 3  # the newest are not judged
    assert plain["authority_epoch"] == state.epoch
    assert plain["states_total"] == 200
    assert metrics.statistics is not None
    assert plain["rtt_seconds_count"] == metrics.statistics.rtt.n > 190
    assert plain["log_bytes"] == 1234
    assert plain["log_free_bytes"] > 0
    assert plain["log_lost"] == 0
    assert found["mode", frozenset({("mode", "active")})] == 1
    assert found["mode", frozenset({("mode", "idle")})] == 0
    assert found["setpoints_rejected_total", frozenset({("reason", "epoch")})] == 2
    assert found["setpoints_rejected_total", frozenset({("reason", "size")})] == 0
    assert found["events_total", frozenset({("kind", "granted")})] == 1


def test_met_and_missed_never_go_back(ring: Ring) -> None:
    bench = Bench(lambda tick, answer: [] if tick % 3 else [(1000, answer)], misses_to_stop=999)
    bench.link.ask("acquire", "alice")
    bench.run(100)
    statistics = RunStatistics(1_000_000)
    metrics = ServiceMetrics(
        "robot", "arm", ring, LogFacts(None, lambda: 0, lambda: False), statistics
    )
    seen: list[tuple[float, float]] = []
    for place, record in enumerate(bench.recorder.records):
        statistics.add(record)
        if place % 7:
            continue
        values = {
            sample.name: sample.value for family in metrics.collect() for sample in family.samples
        }
        if "hoap3_deadlines_met_total" in values:
            met, missed = (values[f"hoap3_deadlines_{how}_total"] for how in ("met", "missed"))
            seen.append((met, missed))
    assert seen == sorted(seen)
    assert seen == sorted(seen, key=lambda both: both[1])


@settings(max_examples=20)  # each has a histogram of its own
@given(st.lists(st.integers(0, 3_000_000_000), max_size=50))
def test_buckets_hold_what_is_not_longer_than_their_bound(values: list[int]) -> None:
    durations = Durations()
    for value in values:
        durations.add(value)
    buckets, total = histogram(durations, BUCKETS_US)
    assert total == pytest.approx(sum(values) / 1e9)
    counts = [count for _, count in buckets]
    assert counts == sorted(counts)
    assert (buckets[-1][0], counts[-1]) == ("+Inf", len(values))
    for bound_us, (label, count) in zip(BUCKETS_US, buckets, strict=False):
        assert float(label) == pytest.approx(bound_us / 1e6)
        low, high = (sum(v <= bound_us * 1000 * s for v in values) for s in (1 - 1e-3, 1 + 1e-3))
        assert low <= count <= high


def test_rejections_by_reason_come_from_the_loop(ring: Ring) -> None:
    bench = Bench()

    class Counting(type(bench.recorder)):  # type: ignore[misc]
        def reject(self, kind: int) -> None:
            ring.count(kind)

    bench.recorder = bench.robot._recorder = Counting()
    bench.link.ask("acquire", "alice")
    bench.run(3)
    bench.speed[:] = np.nan
    bench.run(5)
    counts = dict(zip(REJECTION_KINDS, ring.counts(len(REJECTION_KINDS)), strict=True))
    assert counts == bench.robot.validator.rejections
    assert counts["not_finite"] > 0


def test_a_port_that_is_taken_is_an_error(ring: Ring) -> None:
    metrics = ServiceMetrics("controller", "arm", ring, LogFacts(None, lambda: 0, lambda: False))
    why = os.strerror(errno.EADDRINUSE)
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(OSError, match=why):
        MetricsServer(metrics, "127.0.0.1", taken.getsockname()[1])


def observed(monkeypatch: pytest.MonkeyPatch, **settings: Any) -> ObserverConfig:
    """The config of the observer of a robot with these settings."""
    monkeypatch.setattr(services, "ObserverHandle", lambda config, _: config)
    config: Any = services.observer_for(
        "robot",
        "arm",
        parse(EmulatorConfig, {"robot": "ur5", **settings}, "mine.yaml"),
        None,
        period_ns=1_000_000,
        lockstep=False,
        status_fd=None,
        report=print,
    )
    return config


def test_without_the_extra_a_service_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    assert observed(monkeypatch).metrics is None
    config = observed(monkeypatch, metrics={"port": 9464})
    assert config.metrics == MetricsSettings(port=9464)
    assert config.certificate_ends is None
    monkeypatch.setattr(extras, "find_spec", lambda _: None)
    assert observed(monkeypatch).metrics is None
    with pytest.raises(NotInstalledError, match=r"hoap3\[metrics\]"):
        observed(monkeypatch, metrics={"port": 9464})


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost", "127.1.2.3"])
def test_loopback_is_seen_by_nobody_else(host: str) -> None:
    assert is_loopback(host)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.10", "::", "robot.lab"])
def test_other_addresses_are_seen(host: str) -> None:
    assert not is_loopback(host)


@pytest.mark.slow
def test_the_end_of_a_certificate_is_told_where_there_is_one(
    ring: Ring, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "certificate_expiry_seconds", frozenset[tuple[str, str]]()
    certs = laboratory(tmp_path / "certs")
    link = {"secure": str(certs / "arm"), "listen": ["tls/127.0.0.1:7447"]}
    config = observed(monkeypatch, metrics={"port": 9464}, link=link)
    bench = Bench()
    bench.run(2)
    metrics = of_a_run(bench, ring)
    assert name not in read(metrics)
    metrics.certificate_ends = config.certificate_ends
    assert read(metrics)[name] == read_credentials(certs / "arm").expires.timestamp()


def test_a_client_that_cannot_be_accepted_is_not_tried_at_once_again(ring: Ring) -> None:
    tried, goes_on = threading.Semaphore(0), threading.Event()

    def pause(_: float) -> None:
        tried.release()
        goes_on.wait()

    server = MetricsServer(of_a_run(Bench(), ring), "127.0.0.1", free_port(), pause)
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    with socket.socket() as client:
        first_free = os.dup(client.fileno())
        os.close(first_free)
        resource.setrlimit(resource.RLIMIT_NOFILE, (first_free, before[1]))
        try:
            client.connect(("127.0.0.1", int(server.url.split(":")[2].split("/")[0])))
            assert tried.acquire(timeout=PATIENCE_S)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, before)
            goes_on.set()
        client.sendall(b"GET /metrics HTTP/1.0\r\n\r\n")
        assert b" 200 " in client.recv(100)
    server.close()


def test_bad_connections_are_closed_and_counted_in_one_line(
    ring: Ring, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(metrics_module, "IDLE_S", 0.05)
    server = MetricsServer(of_a_run(Bench(), ring), "127.0.0.1", free_port())
    place = "127.0.0.1", int(server.url.split(":")[2].split("/")[0])
    told: list[str] = []
    monkeypatch.setattr(output, "to_people", told.append)
    for sent in (b"", b"GET /metrics HT", b"\x00\xff\r\n\r\n"):
        with socket.create_connection(place, PATIENCE_S) as client:
            client.sendall(sent)
            while client.recv(4096):
                continue  # until the server has closed it
    while not told:
        with socket.create_connection(place, PATIENCE_S) as client:
            client.sendall(b"GET /metrics HTTP/1.0\r\n")
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    server.close()
    assert len(told) == 1
    assert "Traceback" not in capsys.readouterr().err
