"""What a machine does just now: its clock, and how late it wakes up."""

from __future__ import annotations

from itertools import pairwise

from hoap3.protocol.runtime.deadlines import Durations
from hoap3.protocol.runtime.realtime import Ticker
from hoap3.tools.doctor.system import Finding, System

READS = 2000
COARSE_NS, SLOW_NS = 1_000, 2_000  # of a step, of a reading: a cycle has some fifteen stamps
USELESS_NS = 100_000
PERIOD_NS = 1_000_000
TICKS = 300
LATE_US = 250.0  # a quarter of a period is gone before anything is done


def clock(system: System) -> Finding:
    """How fine is the monotonic clock, and what does a reading cost?"""
    now = system.clock.now
    stamps = [now() for _ in range(READS)]
    steps = [after - before for before, after in pairwise(stamps)]
    if min(steps) < 0 or not any(steps):
        remedy = "`dmesg | grep -i clocksource` says why; on a VM update the hypervisor"
        return Finding("clock", "problem", "stands still or goes back", remedy)
    finest = min(step for step in steps if step)
    cost = (stamps[-1] - stamps[0]) / (READS - 1)
    found = f"steps of {finest} ns, {cost:.0f} ns a reading"
    if finest >= USELESS_NS:
        remedy = "Boot without clocksource=; `dmesg | grep -i clocksource` says what was wrong"
        return Finding("clock", "problem", found, remedy)
    if finest > COARSE_NS or cost > SLOW_NS:
        remedy = "Boot with clocksource=tsc if `dmesg | grep -i tsc` calls it stable"
        return Finding("clock", "advice", found, remedy)
    return Finding("clock", "ok", found)


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
