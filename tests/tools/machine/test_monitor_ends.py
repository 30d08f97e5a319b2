"""Stall monitors end with whoever started them, and leave no CPU cpu_idle, however that ends."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from support import HOUSE
from support.fake_rights import FakeCpu

from hoap3.tools.machine import cpu_idle
from hoap3.tools.machine.stalls import StallMonitor

HOLDER = """
import sys
from hoap3.tools.machine.stalls import StallMonitor
monitor = StallMonitor([0], keep_awake=True)
while not monitor.logs[0].runs:
    pass
print(monitor._processes[0].pid, flush=True)
sys.stdin.read()
"""


@pytest.fixture
def cpu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeCpu:
    """A CPU that this process and its children can keep awake."""
    fake = FakeCpu(tmp_path)
    for name, value in fake.environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(cpu_idle, "SYSTEM", Path(fake.environment["FAKE_CPUS"]))
    return fake


@pytest.fixture
def _sigterm_ignored() -> Iterator[None]:
    """As once in the observer; children inherit it."""
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    yield
    signal.signal(signal.SIGTERM, before)


def running(cpu: FakeCpu) -> StallMonitor:
    """A monitor that has begun."""
    monitor = StallMonitor([0], keep_awake=True).__enter__()
    assert monitor.refused() == monitor.killed() == []
    assert monitor.logs[0].runs
    assert cpu.setting == cpu_idle.NO_LATENCY
    return monitor


def held() -> tuple[subprocess.Popen[str], int]:
    """A process with a monitor that runs, and the monitor's process id."""
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=HOUSE,
    )
    assert holder.stdout is not None
    return holder, int(holder.stdout.readline())


def killed(holder: subprocess.Popen[str]) -> None:
    holder.kill()
    holder.communicate()


def wait_for_end(pid: int) -> None:
    handle = os.pidfd_open(pid)
    assert select.select([handle], [], [], 60.0)[0], f"monitor {pid} lives on"
    os.close(handle)


@pytest.mark.usefixtures("_sigterm_ignored")
def test_one_that_is_stopped_at_once_ends_though_it_ignores_sigterm_still(cpu: FakeCpu) -> None:
    monitor = StallMonitor([0], keep_awake=True)
    monitor.stop()
    assert monitor._processes[0].poll() is not None
    cpu.assert_nothing_left()


@pytest.mark.usefixtures("_sigterm_ignored")
def test_one_that_runs_ends_in_order(cpu: FakeCpu) -> None:
    monitor = running(cpu)
    monitor.stop()
    assert monitor._processes[0].returncode == 0
    cpu.assert_nothing_left()


@pytest.mark.slow
def test_one_that_hangs_is_killed_and_its_cpu_may_sleep(cpu: FakeCpu) -> None:
    monitor = running(cpu)
    os.kill(monitor._processes[0].pid, signal.SIGSTOP)
    monitor.stop()
    assert monitor._processes[0].returncode == -signal.SIGKILL
    cpu.assert_nothing_left()


def test_a_killed_one_is_noticed_and_its_cpu_may_sleep(cpu: FakeCpu) -> None:
    monitor = running(cpu)
    monitor._processes[0].kill()
    wait_for_end(monitor._processes[0].pid)
    assert monitor.killed() == [0]
    assert monitor.refused() == []
    assert not monitor.logs[0].runs  # its stalls are unknown from here on
    cpu.assert_nothing_left()
    monitor.stop()


def test_one_whose_parent_is_killed_ends(cpu: FakeCpu) -> None:
    holder, monitor = held()
    handle = os.pidfd_open(monitor)
    killed(holder)
    assert select.select([handle], [], [], 60.0)[0]
    os.close(handle)
    cpu.assert_nothing_left()


def test_what_both_left_that_were_killed_together_the_next_one_mends(cpu: FakeCpu) -> None:
    holder, monitor = held()
    handle = os.pidfd_open(monitor)
    os.kill(monitor, signal.SIGSTOP)  # it cannot see its parent die
    killed(holder)
    os.kill(monitor, signal.SIGKILL)
    assert select.select([handle], [], [], 60.0)[0]
    os.close(handle)
    assert cpu.setting == cpu_idle.NO_LATENCY
    StallMonitor([], keep_awake=True).stop()
    cpu.assert_nothing_left()
