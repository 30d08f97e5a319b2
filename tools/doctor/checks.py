"""What a machine is: one small check for each thing that a 1 kHz loop in soft real time needs.

A check reads, compares and advises; it changes nothing (`log_disk` writes, and deletes, a file of
its own), and what cannot be read is never an error. docs/realtime_rights.md says what each finding
means.
"""

from __future__ import annotations

import re
import resource

from hoap3.protocol.config.settings import LogSettings
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.tools.doctor.system import Finding, System

ROOM = 2 * LogSettings().cap_mb * 1_000_000  # bytes: one run, both sides
LEAST_ROOM = 100_000_000
SLOW_DISK = 5_000_000  # bytes/s; HOAP-3 at 1 kHz writes some 0.3 MB/s, both sides together
IDLE_EXIT_US = 100  # a tenth of a period spent on waking up
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
    shares = [share for share in map(_quota, *_quota_files(system)) if share is not None]
    if not shares:
        return Finding("CPU quota", "ok", "none")
    share = min(shares)
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


def _amount(limit: int) -> str:
    return "unlimited" if limit == resource.RLIM_INFINITY else str(limit)


def _quota_files(system: System) -> tuple[list[str], list[str]]:
    """Quota and period of every control group that this process is in."""
    quotas, periods = [], []
    for line in system.text("proc/self/cgroup").splitlines():
        controllers, _, path = line.partition(":")[2].partition(":")
        if not controllers:
            mounts, names = ("sys/fs/cgroup", "sys/fs/cgroup/unified"), ("cpu.max", "cpu.max")
        elif "cpu" in controllers.split(","):
            mounts = ("sys/fs/cgroup/cpu", "sys/fs/cgroup/cpu,cpuacct")
            names = ("cpu.cfs_quota_us", "cpu.cfs_period_us")
        else:
            continue
        parts = [part for part in path.split("/") if part not in {"", ".."}]
        for depth in range(len(parts) + 1):
            for mount in mounts:
                folder = "/".join([mount, *parts[:depth]])
                quotas.append(system.text(f"{folder}/{names[0]}"))
                periods.append(system.text(f"{folder}/{names[1]}"))
    return quotas, periods


def _quota(quota: str, period: str) -> float | None:
    """CPUs that a quota leaves, or None where there is none; `cpu.max` has both in one line."""
    amount, length = quota.split()[:1], period.split()[-1:]
    if not amount or not length or not amount[0].isdecimal() or not length[0].isdecimal():
        return None
    return int(amount[0]) / int(length[0]) if int(length[0]) else None
