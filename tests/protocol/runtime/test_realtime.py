"""What a process asks of the operating system: obtained or refused, reported, never raised.

Nothing here gives the process of the tests itself a CPU or a priority.
"""

from __future__ import annotations

import ctypes
import errno
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from hoap3.protocol.config.settings import RealtimeSettings
from hoap3.protocol.runtime import realtime
from hoap3.protocol.runtime.realtime import claim_cpu, claim_cpus, prepare_process, virtual_machine

HERE = Path(__file__).parent
NOBODY = "65534"
AS_ROOT = os.geteuid() == 0


def start(folder: Path, *arguments: str) -> subprocess.Popen:
    """The helper as a child whose locks lie in `folder`."""
    return subprocess.Popen(
        [sys.executable, str(HERE / "realtime_child.py"), *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(HERE.parent.parent)},
        text=True,
    )


def prepared(folder: Path, *, user: str | None = None, **settings: object) -> dict:
    """Report of a child that has asked for real time."""
    arguments = ["prepare", json.dumps(settings)] + ([user] if user else [])
    child = start(folder, *arguments)
    out, _ = child.communicate(timeout=60)
    assert child.returncode == 0
    return json.loads(out)


@pytest.fixture
def locks(monkeypatch) -> Iterator[Path]:
    """A folder of its own for the locks of CPUs, for us and for our children."""
    with tempfile.TemporaryDirectory(prefix="hoap3-locks-") as folder:
        monkeypatch.setenv("HOAP3_RUNTIME_DIR", folder)
        yield Path(folder)


def test_without_rights_every_measure_is_reported_and_none_is_raised(locks):
    user = NOBODY if AS_ROOT else None
    report = prepared(locks, user=user, policy="auto", cpu=4000, lock_memory=True)
    measures = report["measures"]
    assert not measures["CPU"][0]
    assert "4000" in measures["CPU"][1]
    assert measures["timer slack"] == [True, "timer slack: 1 ns"]
    assert measures["garbage collector"][0]
    assert not report["collector"]
    assert report["switch_interval"] == pytest.approx(1e-4)
    if user:  # else it depends on the limits of whoever runs the tests
        assert not measures["memory lock"][0]
        assert "LimitMEMLOCK" in measures["memory lock"][1]
        assert report["policy"] == os.SCHED_OTHER
        unpinned = prepared(locks, user=user, policy="auto", cpu="none")
        policy = unpinned["measures"]["scheduling policy"]
        assert not policy[0]
        assert "LimitRTPRIO" in policy[1]
        assert unpinned["policy"] == os.SCHED_OTHER


def test_what_is_not_asked_for_is_left_alone(locks):
    report = prepared(locks, policy="none", cpu="none", lock_memory=True)
    assert report["measures"]["CPU"] == [True, "CPU: not pinned, as configured"]
    assert report["measures"]["scheduling policy"] == [
        True,
        "scheduling policy: ordinary, as configured",
    ]
    assert "memory lock" not in report["measures"]
    assert report["affinity"] == report["affinity_before"]
    assert report["policy"] == os.SCHED_OTHER


def test_a_cpu_is_claimed_and_pinned(locks):
    report = prepared(locks, policy="none", cpu="auto")
    assert report["measures"]["CPU"] == [True, f"CPU: pinned to {report['affinity_before'][-1]}"]
    assert report["affinity"] == [report["affinity_before"][-1]]


@pytest.mark.parametrize("cpu", [4000, 2**31, 2**62])
def test_a_cpu_that_does_not_exist_is_refused(cpu):
    before = os.sched_getaffinity(0)
    measure = realtime._pin(RealtimeSettings(cpu=cpu))
    assert not measure.obtained
    assert measure.detail.startswith(f"pinning to {cpu}: ")
    assert os.sched_getaffinity(0) == before


def test_where_every_cpu_is_claimed_nothing_is_pinned(locks):
    claims = [claim_cpu({cpu}) for cpu in os.sched_getaffinity(0)]
    measure = realtime._pin(RealtimeSettings(cpu="auto"))
    assert not measure.obtained
    assert all(claims)
    for claim in claims:
        claim.release()


def test_a_claim_is_exclusive_between_two_processes_and_ends_with_its_holder(locks):
    holder = start(locks, "claim", "3")
    assert holder.stdout.readline() == "3\n"
    second = start(locks, "claim", "3")
    assert second.stdout.readline() == "None\n"
    assert claim_cpu({3}) is None
    holder.kill()
    holder.communicate()
    ours = claim_cpu({3})
    assert ours.cpu == 3
    ours.release()
    second.communicate()


def test_the_highest_free_cpu_of_those_allowed_is_claimed(locks):
    claims = [claim_cpu({0, 2, 5}) for _ in range(4)]
    assert [claim.cpu if claim else None for claim in claims] == [5, 2, 0, None]
    for claim in claims[:3]:
        claim.release()
    assert claim_cpu(set()) is None


def test_the_last_can_be_left_to_others_while_another_is_free(locks):
    claims = [claim_cpu({0, 2, 5}, leave=1) for _ in range(4)]
    assert [claim.cpu if claim else None for claim in claims] == [2, 0, 5, None]
    for claim in claims[:3]:
        claim.release()
    alone = claim_cpu({4}, leave=1)
    assert alone.cpu == 4
    alone.release()


def test_without_a_list_the_cpus_of_this_process_are_allowed(locks):
    claim = claim_cpu()
    assert claim.cpu == max(os.sched_getaffinity(0))
    claim.release()


def test_a_robot_and_a_controller_can_share_a_cpu_that_no_other_run_has(locks):
    robot = claim_cpu({1, 2}, sides=("robot",))
    controller = claim_cpu({1, 2}, sides=("controller",))
    assert robot.cpu == controller.cpu == 2
    whole = claim_cpu({1, 2})
    assert whole.cpu == 1
    assert claim_cpu({1, 2}, sides=("robot",)) is None
    controller.release()
    assert claim_cpu({2}) is None
    robot.release()
    again = claim_cpu({2})
    assert again.cpu == 2
    for claim in (whole, again):
        claim.release()


def test_a_side_that_is_taken_leaves_no_lock_of_the_other_behind(locks):
    controller = claim_cpu({2}, sides=("controller",))
    assert claim_cpu({2}) is None
    robot = claim_cpu({2}, sides=("robot",))
    assert robot.cpu == 2
    robot.release()
    controller.release()


def test_without_a_private_directory_nothing_is_locked(locks, monkeypatch):
    locks.chmod(0o777)
    first, second = claim_cpu({2}), claim_cpu({2})
    assert first.cpu == second.cpu == 2
    assert [claim.cpu for claim in claim_cpus(3, {1, 2})] == [2, 1]
    assert not list(locks.iterdir())


def test_what_lies_in_place_of_a_lock_file_is_passed_over(locks):
    (locks / "cpu9-robot.lock").mkdir()
    (locks / "cpu8-robot.lock").symlink_to(locks / "elsewhere")
    os.mkfifo(locks / "cpu7-robot.lock")
    claim = claim_cpu({6, 8})
    assert claim.cpu == 6
    assert not (locks / "elsewhere").exists()
    claim.release()
    assert claim_cpu({7}) is None  # not waited for
    assert claim_cpu({9}) is None


class Libc:
    """A C library that grants everything, or refuses everything with one error."""

    def __init__(self, error: int = 0) -> None:
        self._error = error

    def prctl(self, *arguments: object) -> int:
        ctypes.set_errno(self._error)
        return -1 if self._error else 0

    mlockall = prctl


def test_a_refusal_tells_its_reason():
    libc = Libc(errno.EPERM)
    for measure in (realtime._timer_slack(libc), realtime._lock_memory(libc)):
        assert not measure.obtained
        assert os.strerror(errno.EPERM) in str(measure)


@pytest.fixture
def generous(monkeypatch) -> list[tuple]:
    """An operating system that grants everything and changes nothing; what it was asked for."""
    asked: list[tuple] = []

    def granting(name: str):
        return lambda *what: asked.append((name, *what))

    monkeypatch.setattr(ctypes, "CDLL", lambda *_, **__: Libc())
    monkeypatch.setattr(realtime.resource, "setrlimit", granting("setrlimit"))
    for name in ("sched_setaffinity", "sched_setscheduler"):
        monkeypatch.setattr(os, name, granting(name))
    for name in ("collect", "freeze", "disable"):
        monkeypatch.setattr(realtime.gc, name, granting(name))
    monkeypatch.setattr(sys, "setswitchinterval", granting("setswitchinterval"))
    monkeypatch.setattr(realtime, "_claims", [])
    return asked


def test_where_everything_is_granted_everything_is_done_once(locks, generous):
    cpu = max(os.sched_getaffinity(0))
    measures = prepare_process(RealtimeSettings(priority=42))
    assert [str(measure) for measure in measures] == [
        f"CPU: pinned to {cpu}",
        "timer slack: 1 ns",
        "memory lock: pages stay once touched",
        "scheduling policy: SCHED_FIFO 42",
        "garbage collector: frozen and off",
    ]
    names = [name for name, *_ in generous]
    assert sorted(names) == sorted(set(names))
    assert names.index("collect") < names.index("freeze")
    assert names.index("setrlimit") < names.index("sched_setscheduler")  # never without an end
    assert ("sched_setaffinity", 0, {cpu}) in generous
    assert claim_cpu({cpu}) is None  # for as long as the process lives
    realtime._claims[0].release()


def test_an_ordinary_process_locks_no_memory_and_keeps_its_policy(generous):
    measures = prepare_process(RealtimeSettings(policy="none", cpu="none"))
    assert [measure.name for measure in measures] == [
        "CPU",
        "timer slack",
        "scheduling policy",
        "garbage collector",
    ]
    assert {name for name, *_ in generous} == {"collect", "freeze", "disable", "setswitchinterval"}


def test_a_limit_that_cannot_be_raised_is_a_refusal(monkeypatch):
    def refuse(*what: object) -> None:
        raise ValueError("not allowed to raise maximum limit")

    monkeypatch.setattr(realtime.resource, "setrlimit", refuse)
    measure = realtime._schedule(RealtimeSettings())
    assert not measure.obtained
    assert "LimitRTPRIO" in measure.detail


def test_a_virtual_machine_is_known_by_what_its_processor_says(monkeypatch, tmp_path):
    for flags, expected in (("fpu hypervisor sse", True), ("fpu sse", False)):
        cpuinfo = tmp_path / "cpuinfo"
        cpuinfo.write_text(f"flags\t\t: {flags}\n")
        monkeypatch.setattr(realtime, "Path", lambda _, cpuinfo=cpuinfo: cpuinfo)
        assert virtual_machine() is expected
    monkeypatch.setattr(realtime, "Path", lambda _: tmp_path / "none")
    assert not virtual_machine()


def test_without_a_cpu_of_its_own_a_process_stays_ordinary(generous, monkeypatch):
    monkeypatch.setattr(realtime, "claim_cpu", lambda: None)
    measures = {each.name: each for each in prepare_process(RealtimeSettings(lock_memory=False))}
    assert not measures["CPU"].obtained
    assert not measures["scheduling policy"].obtained
    assert "sched_setscheduler" not in {name for name, *_ in generous}
