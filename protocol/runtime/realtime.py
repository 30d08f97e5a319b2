"""Real time as far as a plain kernel gives it: process set-up and an absolute schedule.

Every measure is tried and reported as obtained or refused; none is fatal. This is soft real
time: an observed maximum is not a bound.
"""

from __future__ import annotations

import ctypes
import fcntl
import gc
import os
import resource
import stat
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hoap3.protocol.config.settings import RealtimeSettings
from hoap3.protocol.runtime.clock import Clock
from hoap3.protocol.runtime.private_directory import runtime_directory

_PR_SET_TIMERSLACK = 29
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_RTTIME_LIMIT_US = 10_000_000  # CPU time without a sleep that ends a runaway loop; builds take less
_SWITCH_INTERVAL_S = 1e-4

START_DELAY_NS = 10_000_000

SIDES = ("robot", "controller")
"""Each CPU can be claimed for one robot and one controller."""


@dataclass(frozen=True)
class Measure:
    """One thing asked of the operating system.

    Attributes:
        name: what was asked.
        obtained: whether it was given.
        detail: its value, or why it was refused and what would help.
    """

    name: str
    obtained: bool
    detail: str

    def __str__(self) -> str:
        return f"{self.name}: {'' if self.obtained else 'refused, '}{self.detail}"


class CpuClaim:
    """The claim of one CPU among the runs on this machine, held until released."""

    def __init__(self, cpu: int, locks: list[int]) -> None:
        self.cpu, self._locks = cpu, locks

    def release(self) -> None:
        """Let another run have it."""
        while self._locks:
            os.close(self._locks.pop())


def claim_cpu(
    allowed: set[int] | None = None, *, leave: int = 0, sides: Sequence[str] = SIDES
) -> CpuClaim | None:
    """Claim the highest allowed CPU that no other run has claimed, or None.

    The highest comes first: interrupts and services gather on the first. Claims are locks in the
    user's runtime directory, so that runs of other users do not see them; where there is no such
    directory, nothing is locked.

    Args:
        allowed: CPUs to choose from, by default those that this process may run on.
        leave: so many of the last are taken only where no other is free.
        sides: both, for a CPU of one's own; one of `SIDES` where a service of the other side may
            share it.
    """
    order = sorted(os.sched_getaffinity(0) if allowed is None else allowed, reverse=True)
    directory = runtime_directory()
    for cpu in order[leave:] + order[:leave]:
        paths = [directory / f"cpu{cpu}-{side}.lock" for side in sides] if directory else []
        locks = [_locked(path) for path in paths]
        held = [lock for lock in locks if lock is not None]
        claim = CpuClaim(cpu, held)
        if len(held) == len(locks):
            return claim
        claim.release()
    return None


def claim_cpus(count: int, allowed: set[int] | None = None) -> list[CpuClaim]:
    """Claim up to so many CPUs, each another one, also where nothing can be locked."""
    free = set(os.sched_getaffinity(0) if allowed is None else allowed)
    claims: list[CpuClaim] = []
    while len(claims) < count and (claim := claim_cpu(free)) is not None:
        claims.append(claim)
        free.discard(claim.cpu)
    return claims


def _locked(path: Path) -> int | None:
    """The file, locked without waiting; None where another run has it or it is no plain file."""
    flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    try:
        lock = os.open(path, flags, 0o600)
    except OSError:
        return None
    try:
        if stat.S_ISREG(os.fstat(lock).st_mode):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return lock
    except BlockingIOError:
        pass
    os.close(lock)
    return None


def virtual_machine() -> bool:
    """Whether a hypervisor announces itself."""
    try:
        return " hypervisor" in Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False


def prepare_process(settings: RealtimeSettings) -> list[Measure]:
    """Ask the operating system for what a 1 kHz loop needs.

    To be called before the link is opened, so that its threads inherit policy and CPU, and after
    everything was started that must not inherit them.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    measures = [_pin(settings), _timer_slack(libc)]
    if settings.lock_memory and settings.policy != "none":
        measures.append(_lock_memory(libc))
    pinned = measures[0].obtained
    measures.append(_schedule(settings) if pinned else _UNPINNED)
    gc.collect()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    measures.append(Measure("garbage collector", True, "frozen and off"))
    return measures


_UNPINNED = Measure(
    "scheduling policy", False, "SCHED_FIFO without a CPU of its own is slower than none: ordinary"
)


def _pin(settings: RealtimeSettings) -> Measure:
    cpu = settings.cpu
    if cpu == "none":
        return Measure("CPU", True, "not pinned, as configured")
    if cpu == "auto":
        claim = claim_cpu()
        if claim is None:
            return Measure("CPU", False, "every allowed CPU is claimed by another run")
        _claims.append(claim)
        cpu = claim.cpu
    try:
        os.sched_setaffinity(0, {cpu})
    except (OSError, OverflowError) as error:
        return Measure("CPU", False, f"pinning to {cpu}: {_why(error)}")
    return Measure("CPU", True, f"pinned to {cpu}")


_claims: list[CpuClaim] = []  # held as long as the process lives


def _timer_slack(libc: ctypes.CDLL) -> Measure:
    if libc.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(1), 0, 0, 0):
        return Measure("timer slack", False, os.strerror(ctypes.get_errno()))
    return Measure("timer slack", True, "1 ns")


def _lock_memory(libc: ctypes.CDLL) -> Measure:
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT):
        why = os.strerror(ctypes.get_errno())
        return Measure("memory lock", False, f"{why}; raise LimitMEMLOCK or `ulimit -l`")
    return Measure("memory lock", True, "pages stay once touched")


def _schedule(settings: RealtimeSettings) -> Measure:
    if settings.policy == "none":
        return Measure("scheduling policy", True, "ordinary, as configured")
    try:
        resource.setrlimit(resource.RLIMIT_RTTIME, (_RTTIME_LIMIT_US, _RTTIME_LIMIT_US))
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(settings.priority))
    except (OSError, ValueError) as error:
        remedy = "raise LimitRTPRIO or `ulimit -r`, or run as root"
        return Measure("scheduling policy", False, f"{_why(error)}; {remedy}")
    return Measure("scheduling policy", True, f"SCHED_FIFO {settings.priority}")


def _why(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


def schedule_start(clock: Clock, period: int) -> int:
    """When a schedule that is to begin soon has its tick 0 [ns].

    It is a whole multiple of the period [ns] on the clock, so that processes of one machine know
    each other's phase.
    """
    return -(-(clock.now() + START_DELAY_NS) // period) * period


class Ticker:
    """Ticks of an absolute schedule: tick k starts at start + k·period, whatever happens.

    Attributes:
        tick: number of the current tick.
        intended: its start on the schedule [ns].
        actual: when the loop really woke [ns].
        skipped: whole periods that passed unnoticed just before it.
    """

    def __init__(self, clock: Clock, period: int, start: int) -> None:
        self._clock, self._period, self._start = clock, period, start
        self.tick = -1
        self.intended = self.actual = self.skipped = 0

    @property
    def next(self) -> int:
        """Start of the next tick on the schedule [ns]."""
        return self._start + (self.tick + 1) * self._period

    def wait(self) -> None:
        """Sleep until the next tick that can still be kept.

        A wake-up at or after the start of the tick after next has skipped ticks: they are
        counted, the phase is kept, and nothing is made up for in a burst.
        """
        self.tick += 1
        self.intended = self._start + self.tick * self._period
        self._clock.sleep_until(self.intended)
        self.actual = self._clock.now()
        self.skipped = max(0, (self.actual - self.intended) // self._period)
        self.tick += self.skipped
        self.intended += self.skipped * self._period
