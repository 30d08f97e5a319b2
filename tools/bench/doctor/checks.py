"""What a machine is: one small check for each thing that a 1 kHz loop in soft real time needs.

A check reads, compares and advises; it changes nothing (`log_disk` writes, and deletes, a file of
its own), and what cannot be read is never an error. docs/guides/operation.md says what each finding
means.
"""

from __future__ import annotations

import re
import resource
from collections.abc import Iterator
from itertools import pairwise

from hoap3.protocol.config.settings import LogSettings
from hoap3.protocol.runtime.deadlines import Durations
from hoap3.protocol.runtime.realtime import Ticker
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.tools.bench.doctor.system import Finding, System

ROOM = 2 * LogSettings().cap_mb * 1_000_000  # bytes: one run, both sides
LEAST_ROOM = 100_000_000
SLOW_DISK = 5_000_000  # bytes/s; HOAP-3 at 1 kHz writes some 0.3 MB/s, both sides together
IDLE_EXIT_US = 100  # a tenth of a period spent on waking up
READS = 2000
COARSE_NS, SLOW_NS = 1_000, 2_000  # of a step, of a reading: a cycle has some fifteen stamps
USELESS_NS = 100_000
PERIOD_NS = 1_000_000
TICKS = 300
LATE_US = 250.0  # a quarter of a period is gone before anything is done
_CAP_IPC_LOCK, _CAP_SYS_NICE = 14, 23
_CPU = "sys/devices/system/cpu"


def kernel(system: System) -> Finding:
    """Which kernel, and may it interrupt its own work for a loop?"""
    release = system.text("proc/sys/kernel/osrelease") or "unknown"
    build = system.text("proc/sys/kernel/version")
    if system.text("sys/kernel/realtime") == "1" or "PREEMPT_RT" in build:
        return Finding("kernel", "ok", f"{release}, PREEMPT_RT")
    if not build:
        return Finding("kernel", "ok", f"{release}, preemption cannot be read")
    if "PREEMPT_DYNAMIC" in build:
        chosen = re.search(r"\((\w+)\)", system.text("sys/kernel/debug/sched/preempt"))
        booted = re.search(r"\bpreempt=(\w+)", system.text("proc/cmdline"))
        mode = chosen[1] if chosen else booted[1] if booted else ""
        found = f"{release}, PREEMPT_DYNAMIC, {mode or 'mode cannot be read'}"
        if mode not in {"none", "voluntary"}:
            return Finding("kernel", "ok", found)
        remedy = "Boot with preempt=full, or as root: echo full > /sys/kernel/debug/sched/preempt"
        return Finding("kernel", "advice", found, remedy)
    if re.search(r"\bPREEMPT\b", build):
        return Finding("kernel", "ok", f"{release}, PREEMPT")
    remedy = "Install a kernel with PREEMPT_DYNAMIC or PREEMPT_RT, such as a low-latency one"
    return Finding("kernel", "advice", f"{release} without preemption", remedy)


def governor(system: System) -> Finding:
    """Do CPUs keep their speed while a loop sleeps?"""
    governors = {system.text(path) for path in system.paths(f"{_CPU}/cpu*/cpufreq/*_governor")}
    governors.discard("")
    if not governors:
        return Finding("governor", "ok", "no frequency control here (virtual machine, firmware)")
    turbo = {"0": ", no turbo", "1": ", turbo"}.get(system.text(f"{_CPU}/cpufreq/boost"), "")
    turbo = {"0": ", turbo", "1": ", no turbo"}.get(
        system.text(f"{_CPU}/intel_pstate/no_turbo"), turbo
    )
    found = ", ".join(sorted(governors)) + turbo
    if governors == {"performance"}:
        return Finding("governor", "ok", found)
    remedy = "sudo cpupower frequency-set -g performance"
    return Finding("governor", "advice", found, remedy)


def idle_states(system: System) -> Finding:
    """How long does a sleeping CPU need to wake up?"""
    exits: dict[str, int] = {}
    for path in system.paths(f"{_CPU}/cpu0/cpuidle/state*"):
        if not system.number(f"{path}/disable"):
            exits[system.text(f"{path}/name") or "unnamed"] = system.number(f"{path}/latency") or 0
    if not exits:
        return Finding("idle states", "ok", "none to be seen")
    name = max(exits, key=lambda name: exits[name])
    found = f"deepest {name}, {exits[name]} us to wake up"
    if exits[name] <= IDLE_EXIT_US:
        return Finding("idle states", "ok", found)
    remedy = "sudo cpupower idle-set -D 100, or hold /dev/cpu_dma_latency open with 0 in it"
    return Finding("idle states", "advice", found, remedy)


def realtime_priority(system: System) -> Finding:
    """May a loop go before everything else?"""
    priority = EmulatorConfig().realtime.priority  # the higher of both
    refusal = system.fifo(priority)
    soft, hard = system.limit(resource.RLIMIT_RTPRIO)
    if refusal is None:
        return Finding("real-time priority", "ok", f"SCHED_FIFO {priority} is granted")
    found = f"SCHED_FIFO {priority} is refused: {refusal}; limit {_amount(soft)}"
    if system.capable(_CAP_SYS_NICE) or soft == resource.RLIM_INFINITY or soft >= priority:
        remedy = (
            "A container or group forbids it: --cap-add SYS_NICE --ulimit rtprio=99, and "
            "cpu.rt_runtime_us above 0"
        )
    elif hard == resource.RLIM_INFINITY or hard >= priority:
        remedy = f"ulimit -r {priority}"
    else:
        remedy = "/etc/security/limits.d: `@realtime - rtprio 99`, log in anew; LimitRTPRIO=99"
    return Finding("real-time priority", "advice", found, remedy)


def memory_lock(system: System) -> Finding:
    """May a loop keep its pages?"""
    soft, _ = system.limit(resource.RLIMIT_MEMLOCK)
    if system.capable(_CAP_IPC_LOCK):
        return Finding("memory lock", "ok", "no limit for this process (CAP_IPC_LOCK)")
    if soft == resource.RLIM_INFINITY:
        return Finding("memory lock", "ok", "unlimited")
    remedy = "/etc/security/limits.d: `@realtime - memlock unlimited`; LimitMEMLOCK=infinity"
    return Finding("memory lock", "advice", f"limit {soft / 1024**2:.0f} MiB", remedy)


def virtualisation(system: System) -> Finding:
    """Is there a host below that can take the CPUs away?"""
    host = system.virtual()
    if not host:
        return Finding("virtualisation", "ok", "bare metal, as far as it shows")
    remedy = "Bare metal, or ask the host for dedicated, pinned CPUs; no setting in here helps"
    return Finding("virtualisation", "advice", f"virtual machine ({host})", remedy)


def cpu_quota(system: System) -> Finding:
    """Does a control group stop everything for the rest of each period?"""
    share = min(_quotas(system), default=None)
    if share is None:
        return Finding("CPU quota", "ok", "none")
    found = f"{share:.2f} CPUs; once used up, everything stands still until the next period"
    remedy = "Take the limit away: docker without --cpus, Kubernetes without limits.cpu, CPUQuota="
    return Finding("CPU quota", "problem" if share < 1 else "advice", found, remedy)


def kernel_cache(system: System) -> Finding:
    """Are compiled kernels kept for the next start?"""
    folder, kept = system.kernel_cache()
    if kept:
        return Finding("kernel cache", "ok", str(folder))
    found = f"only until the process ends: {folder}" if folder else "nowhere"
    remedy = "Set HOAP3_CACHE_DIR to a folder that is yours alone (chmod 700)"
    return Finding("kernel cache", "advice", found, remedy)


def log_disk(system: System) -> Finding:
    """Can logs be written, is there room, and does the disk keep up?"""
    folder = system.logs.absolute()
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        free, speed = system.free(folder), system.write_speed(folder)
    except OSError as error:
        found = f"{folder}: {error.strerror or error}"
        remedy = "Set log.directory to a folder that can be written, or log.record=false"
        return Finding("disk for logs", "problem", found, remedy)
    rate = f"{speed / 1e6:.0f} MB/s synced" if speed else "no answer within a second"
    found = f"{folder}: {free / 1e9:.1f} GB free, {rate}"
    if free < ROOM:
        remedy = "Make room, or lower log.cap_mb"
        return Finding("disk for logs", "problem" if free < LEAST_ROOM else "advice", found, remedy)
    if speed < SLOW_DISK:
        remedy = "Set log.directory to a faster disk: loops never wait for it, but logs get gaps"
        return Finding("disk for logs", "advice", found, remedy)
    return Finding("disk for logs", "ok", found)


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
        remedy = (
            "Services run at real-time priority where it is granted (below). Otherwise look at "
            "load, CPU governor, idle states, virtualisation and CPU quota"
        )
        return Finding("wake-up", "problem" if share > 0.1 else "advice", found, remedy)
    return Finding("wake-up", "ok", found)


def _amount(limit: int) -> str:
    return "unlimited" if limit == resource.RLIM_INFINITY else str(limit)


def _quotas(system: System) -> Iterator[float]:
    """CPUs that the quota of each control group that this process is in leaves."""
    groups = re.search(r"^0::/?(.*)$", system.text("proc/self/cgroup"), re.MULTILINE)
    parts = [part for part in groups[1].split("/") if part not in {"", ".."}] if groups else []
    for depth in range(len(parts) + 1):
        folder = "/".join(["sys/fs/cgroup", *parts[:depth]])
        quota, _, period = system.text(f"{folder}/cpu.max").partition(" ")
        if quota.isdecimal() and period.isdecimal() and int(period):
            yield int(quota) / int(period)
