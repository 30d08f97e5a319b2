"""What a machine is: every check on machines made of files, good and bad."""

from __future__ import annotations

import resource
from dataclasses import replace
from pathlib import Path

import pytest
from doctor_machine import ADVICE, CLOCK, CPU, OK, PROBLEM, LateClock, machine

from hoap3.tools.doctor import doctor, stack, system
from hoap3.tools.doctor.system import System, cpu_list

INFINITY = resource.RLIM_INFINITY
CHECKS = (*doctor.LOOKS, *doctor.MEASURES)


def siblings(*groups: str) -> dict[str, str]:
    return {f"{CPU}/cpu{n}/topology/thread_siblings_list": group for n, group in enumerate(groups)}


def limit(soft: int, hard: int):
    return lambda _: (soft, hard)


BUILD = "#1 SMP PREEMPT_DYNAMIC @0"
VM = {"proc/cpuinfo": "flags\t: fpu hypervisor sse"}
ADMIN = {"proc/self/status": "CapInh:\t0\nCapEff:\t000001ffffffffff"}
NOBODY = {"proc/self/status": "CapInh:\t000001ffffffffff\nCapEff:\t0000000000000000"}
SWAPS = "Filename Type Size Used Priority\n/swapfile file 1000 2048 -2"
V2, V1 = {"proc/self/cgroup": "0::/a/b"}, {"proc/self/cgroup": "1:cpu,cpuacct:/a\n0::/"}
QUOTA_V1 = {
    "sys/fs/cgroup/cpu/a/cpu.cfs_quota_us": "150000",
    "sys/fs/cgroup/cpu/a/cpu.cfs_period_us": "100000",
}

CASES = [
    # check, files, calls, level, in what was found, in the remedy
    ("clock_source", {f"{CLOCK}/current_clocksource": "tsc"}, {}, OK, "tsc", ""),
    ("clock_source", {f"{CLOCK}/current_clocksource": "kvm-clock"}, {}, OK, "kvm-clock", ""),
    ("clock_source", {f"{CLOCK}/current_clocksource": "hpet"}, {}, ADVICE, "hpet", "tsc"),
    ("clock_source", {f"{CLOCK}/current_clocksource": "acpi_pm"}, {}, ADVICE, "acpi_pm", "tsc"),
    ("clock_source", {f"{CLOCK}/current_clocksource": "jiffies"}, {}, PROBLEM, "tick", "dmesg"),
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
    ("realtime_throttling", {"proc/sys/kernel/sched_rt_runtime_us": "950000"}, {}, OK, "95 %", ""),
    ("realtime_throttling", {"proc/sys/kernel/sched_rt_runtime_us": "-1"}, {}, OK, "off", ""),
    (
        "realtime_throttling",
        {"proc/sys/kernel/sched_rt_runtime_us": "400000"},
        {},
        ADVICE,
        "40 %",
        "sysctl",
    ),
    ("realtime_throttling", {"proc/sys/kernel/sched_rt_runtime_us": "0"}, {}, PROBLEM, "0 %", "95"),
    ("memory_lock", NOBODY, {"limit": limit(INFINITY, INFINITY)}, OK, "unlimited", ""),
    ("memory_lock", ADMIN, {"limit": limit(0, 0)}, OK, "CAP_IPC_LOCK", ""),
    ("memory_lock", NOBODY, {"limit": limit(8 << 20, 8 << 20)}, ADVICE, "8 MiB", "memlock"),
    ("timer_slack", {}, {}, OK, "1 ns", ""),
    ("timer_slack", {}, {"timer_slack": lambda: "Denied"}, ADVICE, "Denied", "seccomp"),
    ("cores", {f"{CPU}/online": "0-3"}, {}, OK, "2 of 4", ""),
    ("cores", {f"{CPU}/online": "0"}, {"affinity": lambda: {0}}, ADVICE, "1 of 1", "second CPU"),
    ("smt", siblings("0", "1"), {}, OK, "no two", ""),
    ("smt", siblings("0-1", "0-1"), {}, ADVICE, "1 cores; CPUs that share one: 0, 1", "two cores"),
    (
        "smt",
        siblings("0,2", "1,3", "0,2", "1,3"),
        {"affinity": lambda: {0, 1, 2, 3}},
        OK,
        "2 cores",
        "",
    ),
    (
        "smt",
        siblings("0-1", "0-1", "2-3", "2-3"),
        {"affinity": lambda: {0, 1, 2, 3}},
        ADVICE,
        "0, 1; 2, 3",
        "realtime.cpu",
    ),
    ("virtualisation", {"proc/cpuinfo": "flags\t: fpu sse"}, {}, OK, "bare metal", ""),
    ("virtualisation", VM, {}, ADVICE, "virtual machine", "Bare metal"),
    ("virtualisation", {"sys/hypervisor/type": "xen"}, {}, ADVICE, "xen", "host"),
    ("steal", {"proc/stat": "cpu  10 0 10 979 0 0 0 1 0 0"}, {}, OK, "0.10 %", ""),
    ("steal", {"proc/stat": "cpu  10 0 10 930 0 0 0 50 0 0"}, {}, ADVICE, "5.00 %", "dedicated"),
    ("steal", {"proc/stat": "cpu  1 2 three"}, {}, OK, "cannot be read", ""),
    ("isolation", {f"{CPU}/isolated": "", f"{CPU}/nohz_full": "(null)"}, {}, OK, "none", ""),
    ("isolation", {f"{CPU}/isolated": "1"}, {}, OK, "isolated 1; nohz_full none", ""),
    (
        "isolation",
        {f"{CPU}/isolated": "2-3", f"{CPU}/nohz_full": "2-3"},
        {},
        ADVICE,
        "isolated 2, 3; nohz_full 2, 3",
        "realtime.cpu=3",
    ),
    ("swap", {"proc/swaps": "Filename Type Size Used Priority"}, {}, OK, "none", ""),
    ("swap", {"proc/swaps": SWAPS}, {}, ADVICE, "1 areas, 2 MiB used", "swapoff"),
    ("swap", {"proc/swaps": SWAPS, **ADMIN}, {}, OK, "lock their pages", ""),
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
    ("cpu_quota", {**V1, **QUOTA_V1}, {}, ADVICE, "1.50 CPUs", "docker"),
    ("cpu_quota", {**V1, "sys/fs/cgroup/cpu/a/cpu.cfs_quota_us": "-1"}, {}, OK, "none", ""),
    ("blas_threads", {}, {"environment": {"OMP_NUM_THREADS": "1"}}, OK, "OMP_NUM_THREADS=1", ""),
    ("blas_threads", {}, {"affinity": lambda: {1}}, OK, "one CPU", ""),
    ("blas_threads", {}, {}, ADVICE, "as many", "OMP_NUM_THREADS=1"),
    (
        "blas_threads",
        {},
        {"environment": {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "4"}},  # the latter counts
        ADVICE,
        "OPENBLAS_NUM_THREADS=4",
        "none of the others",
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
    ("port", {}, {}, OK, "tcp/127.0.0.1:7447 is free", ""),
    ("port", {}, {"listen": lambda port: f"{port} in use"}, ADVICE, "7447 in use", "list --live"),
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
    elsewhere = {"clock", "load", "wake_up", "versions"}
    assert good == bad == {check.__name__ for check in CHECKS} - elsewhere


@pytest.mark.parametrize("content", [None, "", "\n", "garbage (", "1 2 3", "0::", "CapEff: zz"])
def test_missing_and_strange_files_never_raise(tmp_path, content):
    paths = {
        "proc/cpuinfo", "proc/cmdline", "proc/stat", "proc/loadavg", "proc/swaps",
        "proc/self/status", "proc/self/cgroup", "proc/sys/kernel/version",
        "proc/sys/kernel/osrelease", "proc/sys/kernel/sched_rt_runtime_us",
        "sys/kernel/realtime", "sys/kernel/debug/sched/preempt", "sys/fs/cgroup/cpu.max",
        f"{CPU}/online", f"{CPU}/isolated", f"{CPU}/nohz_full",
        f"{CPU}/cpu0/topology/thread_siblings_list", f"{CPU}/cpu0/cpufreq/scaling_governor",
        f"{CPU}/cpu0/cpuidle/state0/latency", f"{CLOCK}/current_clocksource",
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


@pytest.mark.parametrize(
    ("text", "cpus"),
    [("0-3,8", {0, 1, 2, 3, 8}), ("5", {5}), ("", set()), ("(null)", set()), ("2-", {2})],
)
def test_a_list_of_cpus_is_read(text, cpus):
    assert cpu_list(text) == cpus


@pytest.mark.parametrize(
    ("requirement", "installed", "level", "found"),
    [
        ("zenoh<1.11,>=1.10", "1.10.2", OK, "supported ranges"),
        ("zenoh<1.11,>=1.10", "1.11.0", ADVICE, "zenoh 1.11.0 (supported: <1.11, >=1.10)"),
        ("zenoh<1.11,>=1.10", "1.9.9", ADVICE, "zenoh 1.9.9"),
        ("zenoh >= 1.10.0", "1.10", OK, "supported ranges"),
        ("pin[extra]>=4.0; python_version > '3'", "3.9", ADVICE, "pin 3.9 (supported: >=4.0)"),
        ("zenoh>=1", None, PROBLEM, "zenoh is missing"),
        ('pytest>=8; extra == "test"', None, ADVICE, "not installed as a package"),
        ("rich", "99", OK, "supported ranges"),
    ],
)
def test_versions_are_held_against_their_ranges(tmp_path, requirement, installed, level, found):
    def version(name: str) -> str | None:
        assert name == requirement.split("[")[0].split("<")[0].split(">")[0].strip()
        return installed

    system = machine(tmp_path, {}, requirements=lambda: [requirement], installed=version)
    finding = stack.versions(system)
    assert finding.level == level
    assert found in finding.found


def test_the_ranges_are_those_of_the_package_itself():
    known = {text.split("<")[0].split(">")[0].strip() for text in system.requirements()}
    assert {"python", "numpy", "eclipse-zenoh", "pin"} <= known
    assert system.installed("python")
    assert system.installed("no-such-distribution") is None
    assert stack.versions(System()).level == OK
