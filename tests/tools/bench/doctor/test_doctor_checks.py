"""What a machine is: every check on machines made of files, good and bad."""

from __future__ import annotations

import resource
from dataclasses import replace
from pathlib import Path

import pytest
from doctor_machine import ADVICE, CPU, OK, PROBLEM, LateClock, machine

from hoap3.tools.bench.doctor import doctor
from hoap3.tools.bench.doctor.system import System

INFINITY = resource.RLIM_INFINITY
CHECKS = (*doctor.LOOKS, *doctor.MEASURES)


def limit(soft: int, hard: int):
    return lambda _: (soft, hard)


BUILD = "#1 SMP PREEMPT_DYNAMIC @0"
VM = {"proc/cpuinfo": "flags\t: fpu hypervisor sse"}
ADMIN = {"proc/self/status": "CapInh:\t0\nCapEff:\t000001ffffffffff"}
NOBODY = {"proc/self/status": "CapInh:\t000001ffffffffff\nCapEff:\t0000000000000000"}
V2 = {"proc/self/cgroup": "1:cpu,cpuacct:/a\n0::/a/b"}

CASES = [
    # check, files, calls, level, in what was found, in the remedy
    ("kernel", {"proc/sys/kernel/version": "#1 SMP PREEMPT_RT"}, {}, OK, "PREEMPT_RT", ""),
    ("kernel", {"sys/kernel/realtime": "1"}, {}, OK, "PREEMPT_RT", ""),
    ("kernel", {"proc/sys/kernel/version": BUILD}, {}, OK, "cannot be read", ""),
    ("kernel", {"proc/sys/kernel/version": "#1 SMP PREEMPT Tue"}, {}, OK, "PREEMPT", ""),
    ("kernel", {"proc/sys/kernel/version": "#1 SMP Tue"}, {}, ADVICE, "without", "PREEMPT_RT"),
    (
        "kernel",
        {
            "proc/sys/kernel/version": BUILD,
            "sys/kernel/debug/sched/preempt": "none voluntary (full) lazy",
            "proc/cmdline": "preempt=none",  # changed since
        },
        {},
        OK,
        "full",
        "",
    ),
    (
        "kernel",
        {
            "proc/sys/kernel/version": BUILD,
            "sys/kernel/debug/sched/preempt": "none (voluntary) full",
            "proc/sys/kernel/osrelease": "6.1.0-9",
        },
        {},
        ADVICE,
        "6.1.0-9, PREEMPT_DYNAMIC, voluntary",
        "preempt=full",
    ),
    (
        "kernel",
        {"proc/sys/kernel/version": BUILD, "proc/cmdline": "quiet preempt=none ro"},
        {},
        ADVICE,
        "none",
        "preempt=full",
    ),
    ("governor", {f"{CPU}/cpu0/cpufreq/scaling_governor": "performance"}, {}, OK, "perf", ""),
    (
        "governor",
        {
            f"{CPU}/cpu0/cpufreq/scaling_governor": "performance",
            f"{CPU}/cpu1/cpufreq/scaling_governor": "powersave",
            f"{CPU}/intel_pstate/no_turbo": "0",
        },
        {},
        ADVICE,
        "performance, powersave, turbo",
        "cpupower",
    ),
    (
        "governor",
        {f"{CPU}/cpu0/cpufreq/scaling_governor": "schedutil", f"{CPU}/cpufreq/boost": "0"},
        {},
        ADVICE,
        "schedutil, no turbo",
        "performance",
    ),
    ("idle_states", {f"{CPU}/cpu0/cpuidle/state0/latency": "2"}, {}, OK, "2 us", ""),
    (
        "idle_states",
        {
            f"{CPU}/cpu0/cpuidle/state1/latency": "1034",
            f"{CPU}/cpu0/cpuidle/state1/name": "C10",
            f"{CPU}/cpu0/cpuidle/state1/disable": "0",
        },
        {},
        ADVICE,
        "C10, 1034 us",
        "idle-set",
    ),
    (
        "idle_states",
        {
            f"{CPU}/cpu0/cpuidle/state0/latency": "1",
            f"{CPU}/cpu0/cpuidle/state1/latency": "1034",
            f"{CPU}/cpu0/cpuidle/state1/disable": "1",
        },
        {},
        OK,
        "1 us",
        "",
    ),
    ("realtime_priority", {}, {"fifo": lambda _: None}, OK, "SCHED_FIFO 85 is granted", ""),
    ("realtime_priority", NOBODY, {}, ADVICE, "not permitted; limit 0", "limits.d"),
    ("realtime_priority", {}, {"limit": limit(84, 98)}, ADVICE, "limit 84", "ulimit -r 85"),
    ("realtime_priority", {}, {"limit": limit(0, INFINITY)}, ADVICE, "limit 0", "ulimit -r"),
    ("realtime_priority", {}, {"limit": limit(98, 98)}, ADVICE, "limit 98", "container"),
    ("realtime_priority", ADMIN, {}, ADVICE, "not permitted", "container"),
    ("memory_lock", NOBODY, {"limit": limit(INFINITY, INFINITY)}, OK, "unlimited", ""),
    ("memory_lock", ADMIN, {"limit": limit(0, 0)}, OK, "CAP_IPC_LOCK", ""),
    ("memory_lock", NOBODY, {"limit": limit(8 << 20, 8 << 20)}, ADVICE, "8 MiB", "memlock"),
    ("virtualisation", {"proc/cpuinfo": "flags\t: fpu sse"}, {}, OK, "bare metal", ""),
    ("virtualisation", VM, {}, ADVICE, "virtual machine", "Bare metal"),
    ("virtualisation", {"sys/hypervisor/type": "xen"}, {}, ADVICE, "xen", "host"),
    ("cpu_quota", {**V2, "sys/fs/cgroup/a/cpu.max": "max 100000"}, {}, OK, "none", ""),
    ("cpu_quota", {**V2, "sys/fs/cgroup/a/cpu.max": "50000 100000"}, {}, PROBLEM, "0.50", "--cpus"),
    (
        "cpu_quota",
        {
            **V2,
            "sys/fs/cgroup/cpu.max": "400000 100000",
            "sys/fs/cgroup/a/b/cpu.max": "200000 100000",
        },
        {},
        ADVICE,
        "2.00 CPUs",
        "CPUQuota",
    ),
    ("kernel_cache", {}, {}, OK, "/cache/kernels-1", ""),
    ("kernel_cache", {}, {"kernel_cache": lambda: (None, False)}, ADVICE, "nowhere", "HOAP3_CACHE"),
    (
        "kernel_cache",
        {},
        {"kernel_cache": lambda: (Path("/tmp/x"), False)},
        ADVICE,
        "/tmp/x",
        "HOAP3_CACHE_DIR",
    ),
    ("log_disk", {}, {}, OK, "100.0 GB free, 100 MB/s", ""),
    ("log_disk", {}, {"free": lambda _: 10**9}, ADVICE, "1.0 GB free", "log.cap_mb"),
    ("log_disk", {}, {"free": lambda _: 10**7}, PROBLEM, "0.0 GB free", "room"),
    ("log_disk", {}, {"write_speed": lambda _: 1e6}, ADVICE, "1 MB/s", "faster"),
    ("log_disk", {}, {"write_speed": lambda _: 0.0}, ADVICE, "no answer", "log.directory"),
]


def check_named(name: str):
    return next(check for check in CHECKS if check.__name__ == name)


@pytest.mark.parametrize(("name", "files", "calls", "level", "found", "remedy"), CASES)
def test_a_check_tells_good_from_bad(tmp_path, name, files, calls, level, found, remedy):
    finding = check_named(name)(machine(tmp_path, files, **calls))
    assert finding.level == level, finding
    assert found in finding.found
    assert remedy in finding.remedy
    assert bool(finding.remedy) == (level != OK)


def test_every_check_is_tried_in_a_good_and_in_a_bad_state():
    good = {case[0] for case in CASES if case[3] == OK}
    bad = {case[0] for case in CASES if case[3] != OK}
    elsewhere = {"clock", "wake_up"}
    assert good == bad == {check.__name__ for check in CHECKS} - elsewhere


@pytest.mark.parametrize("content", [None, "", "\n", "garbage (", "1 2 3", "0::", "CapEff: zz"])
def test_missing_and_strange_files_never_raise(tmp_path, content):
    paths = {
        "proc/cpuinfo", "proc/cmdline",
        "proc/self/status", "proc/self/cgroup", "proc/sys/kernel/version",
        "proc/sys/kernel/osrelease",
        "sys/kernel/realtime", "sys/kernel/debug/sched/preempt", "sys/fs/cgroup/cpu.max",
        f"{CPU}/cpu0/cpufreq/scaling_governor",
        f"{CPU}/cpu0/cpuidle/state0/latency",
    }  # fmt: skip
    files = {} if content is None else dict.fromkeys(paths, content)
    system = machine(tmp_path, files, clock=LateClock([0]))
    for check in CHECKS:
        assert check(system).level in {OK, ADVICE, PROBLEM}


def test_a_capability_is_one_bit(tmp_path):
    lock, nice = 1 << 14, 1 << 23
    for bits in (lock, nice, ~lock & 0xFFFFFF, ~nice & 0xFFFFFF):
        system = machine(tmp_path, {"proc/self/status": f"CapEff:\t{bits:016x}"})
        assert system.capable(14) == bool(bits & lock)
        assert system.capable(23) == bool(bits & nice)


def test_nothing_is_looked_for_outside_the_root(tmp_path):
    real = System()
    bare = replace(real, root=tmp_path)
    assert real.text("proc/self/status")
    assert bare.text("proc/self/status") == ""
    assert not bare.capable(0)
    assert bare.virtual() == ""
