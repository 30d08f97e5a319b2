"""What a machine does just now: its clock, its load, and how late it wakes up."""

from __future__ import annotations

from itertools import pairwise

from hoap3.protocol.runtime.deadlines import Durations
from hoap3.protocol.runtime.realtime import Ticker
from hoap3.tools.doctor.system import Finding, System

READS = 2000
COARSE_NS, SLOW_NS = 1_000, 2_000  # of a step, of a reading: a cycle has some fifteen stamps
USELESS_NS = 100_000
LOAD_WINDOW_NS = 500_000_000
PERIOD_NS = 1_000_000
TICKS = 300
LATE_US = 250.0  # a quarter of a period is gone before anything is done


def clock(system: System) -> Finding:
    """How fine is the monotonic clock, and what does a reading cost?"""
    now = system.clock.now
    stamps = [now() for _ in range(READS)]
    steps = [after - before for before, after in pairwise(stamps)]
    if min(steps) < 0 or not any(steps):
        remedy = "Look at the clock source; on a VM update the hypervisor"
        return Finding("clock", "problem", "stands still or goes back", remedy)
    finest = min(step for step in steps if step)
    cost = (stamps[-1] - stamps[0]) / (READS - 1)
    found = f"steps of {finest} ns, {cost:.0f} ns a reading"
    if finest >= USELESS_NS:
        return Finding("clock", "problem", found, "Choose a finer clock source")
    if finest > COARSE_NS or cost > SLOW_NS:
        return Finding("clock", "advice", found, "Choose a faster clock source, such as tsc")
    return Finding("clock", "ok", found)


def load(system: System) -> Finding:
    """How busy are the CPUs with other things?"""
    before = _busy_and_total(system)
    system.clock.sleep_until(system.clock.now() + LOAD_WINDOW_NS)
    after = _busy_and_total(system)
    if before is None or after is None or after[1] <= before[1]:
        return Finding("load", "ok", "cannot be read")
    cpus = len([line for line in system.text("proc/stat").splitlines() if _is_cpu(line)]) or 1
    busy = cpus * (after[0] - before[0]) / (after[1] - before[1])
    average = (system.text("proc/loadavg").split() or ["?"])[0]
    found = f"{busy:.1f} of {cpus} CPUs busy; average of a minute {average}"
    if cpus - busy >= 1.0 or (cpus == 1 and busy < 0.5):
        return Finding("load", "ok", found)
    return Finding("load", "advice", found, "`top` shows who it is; end it, or grant priority")


def wake_up(system: System) -> Finding:
    """How late does a loop of ordinary priority wake up?"""
    ticker = Ticker(system.clock, PERIOD_NS, system.clock.now() + PERIOD_NS)
    late, skipped = Durations(), 0
    while ticker.tick < TICKS:
        ticker.wait()
        late.add(ticker.actual - ticker.intended)
        skipped += ticker.skipped
    figures = late.summary()
    found = (
        f"p50 {figures['p50']:.0f}, p99 {figures['p99']:.0f}, max {figures['max']:.0f} us; "
        f"{skipped} of {ticker.tick + 1} ticks skipped, at ordinary priority"
    )
    share = skipped / (ticker.tick + 1)
    if share > 0.01 or figures["p50"] > LATE_US:
        remedy = "Real-time priority; else load, governor, idle states, virtualisation, CPU quota"
        return Finding("wake-up", "problem" if share > 0.1 else "advice", found, remedy)
    return Finding("wake-up", "ok", found)


def _busy_and_total(system: System) -> tuple[int, int] | None:
    """Time that all CPUs together were busy, and all time, in the kernel's unit."""
    fields = system.text("proc/stat").partition("\n")[0].split()[1:9]
    if len(fields) < 8 or not all(field.isdecimal() for field in fields):
        return None
    times = [int(field) for field in fields]
    return sum(times) - times[3] - times[4], sum(times)  # less idle and waiting for a disk


def _is_cpu(line: str) -> bool:
    return line.startswith("cpu") and line[3:4].isdecimal()
