"""A real observer beside a loop that a test plays: what it loses is told, and to whom."""

from __future__ import annotations

import errno
import os
import resource
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from support.log_samples import describe, inputs, ticks
from support.systemd.stand_in import PATIENCE_S, SystemdStandIn

from hoap3.protocol.runtime.shm_ring import Kind
from hoap3.tools.logs.log import Log
from hoap3.tools.services.messages import ObserverConfig
from hoap3.tools.services.observer import ObserverHandle
from hoap3.tools.services.services import notify_settings
from hoap3.tools.services.systemd_notify import NotifySettings

pytestmark = pytest.mark.slow

JOINTS, FILE = 4, 200_000


class Service:
    """What an observer stands beside: a ring that is written, and what was told."""

    def __init__(self, folder: Path, **more: Any) -> None:
        self.told = threading.Event()
        self.heard: list[str] = []
        limits = {"cap_bytes": 100 * FILE, "file_bytes": FILE}
        settings = {"folder": folder, **limits, **more}
        config = ObserverConfig("robot", "sample", period_ns=1_000_000, **settings)
        self.observer = ObserverHandle(config, self._report)
        self.pid = self.observer._process.pid

    def _report(self, text: str) -> None:
        self.heard.append(text)
        self.told.set()

    def write(self, count: int) -> None:
        """So many ticks, all of them different; waits while the ring is full."""
        ring = self.observer.ring
        for record in inputs(describe(JOINTS)) + ticks(JOINTS, count):
            while ring.room(Kind.STATE) < 10 and not self.told.is_set():
                self.told.wait(0.01)
            ring.write(*record)


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., Service]]:
    made: list[Service] = []

    def begin(**more: Any) -> Service:
        made.append(Service(**{"folder": tmp_path, **more}))
        return made[-1]

    yield begin
    for service in made:
        service.observer._process.end(0.0)


def wait_until_it_writes(folder: Path) -> None:
    """Its log is open: it will need no descriptor but for the next file."""
    pause = threading.Event()
    while not (folder / "robot.mcap").exists():
        pause.wait(0.01)


@pytest.mark.parametrize("recorded", [True, False])
def test_records_that_an_observer_misses_are_reported_with_and_without_a_log(
    serve, capfd, recorded
):
    service = serve(**({} if recorded else {"folder": None}))
    os.kill(service.pid, signal.SIGSTOP)
    ring = service.observer.ring
    for record in inputs(describe(JOINTS)) + ticks(JOINTS, ring.slots):
        ring.write(*record)
    os.kill(service.pid, signal.SIGCONT)
    assert service.observer.close()
    assert service.observer.result.figures["dropped_records"] == ring.dropped > ring.slots
    assert f"{ring.dropped} records" in capfd.readouterr().err


def test_without_descriptors_the_log_goes_on_in_further_files(
    serve: Callable[..., Service], tmp_path: Path
) -> None:
    service = serve()
    wait_until_it_writes(tmp_path)
    used = {int(entry.name) for entry in Path(f"/proc/{service.pid}/fd").iterdir()}
    free = next(number for number in range(len(used) + 1) if number not in used)
    _, hard = resource.prlimit(service.pid, resource.RLIMIT_NOFILE)
    resource.prlimit(service.pid, resource.RLIMIT_NOFILE, (free, hard))
    service.write(1500)  # a full file is closed before the next one is made
    assert service.observer.close()
    assert service.observer.ring.lost is None
    log = Log.open(tmp_path)
    assert len(log.paths) > 2
    assert len(log.states()) == 1500
    assert not log.missing


def test_a_folder_that_is_gone_ends_the_log_at_the_next_chunk(
    serve: Callable[..., Service], tmp_path: Path
) -> None:
    service = serve()
    wait_until_it_writes(tmp_path)
    (tmp_path / "robot.mcap").unlink()
    service.write(100)
    assert service.told.wait(PATIENCE_S)
    assert service.observer.ring.lost == errno.ENOENT
    assert not service.observer.close()
    assert service.observer.result is not None
    assert service.observer.result.states == 100


def test_when_an_observer_is_killed_its_service_pings_in_its_place(
    serve: Callable[..., Service], tmp_path: Path
) -> None:
    with SystemdStandIn(tmp_path / "notify") as systemd:
        service = serve(notify=NotifySettings(systemd.address, 0.2))
        asked = service.observer.watching(lambda: False)
        asked()
        assert systemd.wait_for(lambda: "READY=1" in systemd.heard)
        service.observer._process.kill()
        assert service.told.wait(PATIENCE_S)
        assert service.observer.ring.lost == 0
        before, pause = systemd.count("WATCHDOG=1"), threading.Event()
        until = time.monotonic() + PATIENCE_S
        while systemd.count("WATCHDOG=1") < before + 5 and time.monotonic() < until:
            asked()  # again and again, as a loop does
            pause.wait(0.001)
        assert systemd.count("WATCHDOG=1") >= before + 5
        assert not service.observer.close()


def test_a_service_of_a_run_tells_systemd_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", "/run/notify")
    assert notify_settings(alone=False) is None
    assert notify_settings(alone=True) == NotifySettings("/run/notify")
