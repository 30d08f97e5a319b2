"""The watchdog is pinged while the loop goes on, and no longer."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.systemd.stand_in import SystemdStandIn

from hoap3.protocol.messages import State
from hoap3.tools.services.systemd_notify import (
    PINGS,
    STATUS_S,
    NotifySettings,
    Watchdog,
    status_words,
)

WATCHDOG_S = 2.0


class Bench:
    """A loop that goes on when the test says so, in time that passes when it says so."""

    def __init__(self, systemd: SystemdStandIn, watchdog_s: float | None = WATCHDOG_S) -> None:
        self.now, self.beats, self.marks = 100.0, 0, 0
        self._systemd = systemd
        settings = NotifySettings(systemd.address, watchdog_s)
        self.watchdog = Watchdog(settings, lambda: self.beats, lambda: self.now)

    def heard(self) -> list[str]:
        """All that was told so far."""
        self.marks += 1
        mark = f"MARK={self.marks}"
        while not self.watchdog._notifier.send(MARK=str(self.marks)):
            self._systemd.wait_for(lambda: False, 0.001)  # its queue is full, of ten datagrams
        assert self._systemd.wait_for(lambda: mark in self._systemd.heard)
        return [line for line in self._systemd.heard if not line.startswith("MARK=")]

    def pings(self) -> int:
        return self.heard().count("WATCHDOG=1")


@pytest.fixture
def systemd(tmp_path: Path):
    with SystemdStandIn(tmp_path / "notify") as made:
        yield made


def test_it_is_ready_at_the_loops_first_sign_of_life(systemd: SystemdStandIn) -> None:
    bench = Bench(systemd)
    bench.watchdog.look()
    assert bench.heard() == []
    bench.beats = 1
    bench.watchdog.look()
    bench.watchdog.look()
    assert bench.heard() == ["READY=1", "WATCHDOG=1"]


def test_a_loop_that_goes_on_is_pinged_for_often_enough(systemd: SystemdStandIn) -> None:
    bench = Bench(systemd)
    for place in range(1000):
        bench.beats += 1
        bench.now += WATCHDOG_S / 100
        bench.watchdog.look()
        if place % 100 == 0:
            bench.heard()  # or its queue would be full
    assert bench.pings() == pytest.approx(10 * PINGS, abs=2)


def test_a_loop_that_stalls_is_not_pinged_for_however_long_it_takes(
    systemd: SystemdStandIn,
) -> None:
    bench = Bench(systemd)
    bench.beats = 7
    bench.watchdog.look()
    before = bench.pings()
    for _ in range(1000):
        bench.now += WATCHDOG_S / 100
        bench.watchdog.look()
    assert bench.pings() == before
    bench.beats += 1  # it comes back
    bench.watchdog.look()
    assert bench.pings() == before + 1


def test_what_did_not_arrive_is_told_again(tmp_path: Path) -> None:
    beats = [1]
    settings = NotifySettings(str(tmp_path / "notify"), WATCHDOG_S)
    watchdog = Watchdog(settings, lambda: beats[0], lambda: 0.0)
    beats[0] = 2
    watchdog.look()
    with SystemdStandIn(tmp_path / "notify") as systemd:
        watchdog.look()
        assert systemd.wait_for(lambda: systemd.heard == ["READY=1", "WATCHDOG=1"])
    watchdog.close()


def test_without_a_watchdog_it_only_says_that_it_is_ready(systemd: SystemdStandIn) -> None:
    bench = Bench(systemd, None)
    for _ in range(100):
        bench.beats += 1
        bench.now += 1.0
        bench.watchdog.look()
    assert bench.heard() == ["READY=1"]


def test_the_status_is_told_where_it_is_new_and_not_too_often(systemd: SystemdStandIn) -> None:
    bench = Bench(systemd)
    for status in ("a", "b", "a"):
        bench.watchdog.tell(status)
    assert bench.heard() == ["STATUS=a"]
    bench.now += STATUS_S
    bench.watchdog.tell("a")
    bench.watchdog.tell("b")
    bench.watchdog.stopping()
    assert bench.heard() == ["STATUS=a", "STATUS=b", "STOPPING=1"]


def test_the_status_of_a_robot_has_its_mode_and_misses() -> None:
    live = {"mode": State.STOPPED, "tick": 12, "late": 2, "lost": 3, "success_rate": 0.5}
    words = status_words(live, 0)
    assert all(part in words for part in ("stopped", "12", "5", "0.5"))
    assert status_words({"ticks": 0}, 0)
    assert "7" in status_words(None, 7)
