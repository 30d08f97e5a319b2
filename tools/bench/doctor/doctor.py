"""`hoap3 doctor`: is this machine fit for a 1 kHz loop, and what would help."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from hoap3.tools.analysis.output import print_json, print_note, results
from hoap3.tools.bench.doctor import checks
from hoap3.tools.bench.doctor.system import Finding, Level, System
from hoap3.tools.machine.machine import machine_block
from hoap3.tools.services.placement import measure_placement, remember

Check = Callable[[System], Finding]

LOOKS: tuple[Check, ...] = (
    checks.virtualisation,
    checks.kernel,
    checks.realtime_priority,
    checks.memory_lock,
    checks.governor,
    checks.idle_states,
    checks.cpu_quota,
    checks.kernel_cache,
)
"""Take no time to speak of."""

MEASURES: tuple[Check, ...] = (checks.clock, checks.wake_up, checks.log_disk)
"""Take a second together, and load the machine a little."""

LARGE_RTT_US, LARGE_TAIL_US = 500.0, 1000.0  # half a period, and a whole one

_COLOURS: dict[str, str] = {"ok": "green", "advice": "yellow", "problem": "red"}
_VERDICTS: dict[Level, str] = {"ok": "pass", "advice": "warn", "problem": "fail"}


def examine(
    root: Path = Path("/"), *, logs: Path = Path("logs"), measure: bool = True
) -> list[Finding]:
    """Look at everything there is to look at.

    Args:
        root: folder below which `/proc` and `/sys` lie.
        logs: folder that logs go to.
        measure: also what takes time.
    """
    system = System(root, logs)
    return [check(system) for check in (*LOOKS, *(MEASURES if measure else ()))]


def placement_finding(placement: dict[str, Any]) -> Finding:
    """What to do about the placement that was measured."""
    name = "CPU placement"
    if not placement["measured"]:
        return Finding(name, "advice", placement["why"], "Ask again when nothing else runs")
    best = placement[placement["recommended"]]["rtt_us"]
    found = "; ".join(
        f"{key.replace('_', ' ')} {_pair(placement[key]['rtt_us'])}"
        for key in ("one_cpu", "two_cpus")
        if key in placement
    )
    found = f"RTT p50 / p99 on {found}; {placement['rights']}"
    if best["p50"] > LARGE_RTT_US:
        remedy = "Half of each period is gone on the link alone: see all the findings above"
        return Finding(name, "problem", found, remedy)
    if best["p99"] > LARGE_TAIL_US:
        remedy = "One answer in a hundred is late on the link alone: grant priority, end other load"
        return Finding(name, "advice", found, remedy)
    choice = placement["recommended"].replace("_", " ")
    return Finding(name, "ok", f"{found}. Runs and services take {choice} until the next boot")


def verdict(findings: Sequence[Finding]) -> str:
    """`pass`, `warn` where there is advice, `fail` where there is a problem."""
    levels = {finding.level for finding in findings}
    worst: Level = "problem" if "problem" in levels else "advice" if "advice" in levels else "ok"
    return _VERDICTS[worst]


def diagnose(*, measure: bool = True, logs: Path = Path("logs")) -> dict[str, Any]:
    """Everything that `doctor --json` prints.

    Args:
        measure: also what takes time: some four seconds.
        logs: folder that logs go to.
    """
    findings = examine(logs=logs, measure=measure)
    placement: dict[str, Any] = {"measured": False, "why": "not asked for"}
    if measure:
        placement = measure_placement()
        remember(placement)
        findings.append(placement_finding(placement))
    return {
        "verdict": verdict(findings),
        "findings": [asdict(finding) for finding in findings],
        "placement": placement,
        "machine": machine_block(),
    }


def run_doctor(as_json: bool, measure: bool = True) -> int:
    """Examine this machine and tell; exit code 1 where there is a problem, else 0."""
    if measure:  # one line, and no spinner: its thread would disturb what is measured
        print_note("measuring for some five seconds")
    diagnosis = diagnose(measure=measure)
    if as_json:
        print_json(diagnosis)
    else:
        show(diagnosis)
    return 1 if diagnosis["verdict"] == "fail" else 0


def show(diagnosis: dict[str, Any]) -> None:
    """Print a diagnosis for people: what was found, and below it what to do."""
    table = Table(show_header=False, box=None, pad_edge=False)
    for finding in diagnosis["findings"]:
        colour = _COLOURS[finding["level"]]
        text = escape(finding["found"])
        if finding["remedy"]:
            text += f"\n[{colour}]→[/] {escape(finding['remedy'])}"
        table.add_row(f"[{colour}]{finding['level']}[/]", finding["name"], text)
    results.print(table)
    levels = [finding["level"] for finding in diagnosis["findings"]]
    results.print(
        f"{diagnosis['verdict']}: {levels.count('problem')} problems, "
        f"{levels.count('advice')} pieces of advice; `hoap3 help operation` explains each",
    )


def _pair(figures: dict[str, Any]) -> str:
    return f"{figures['p50']:.0f} / {figures['p99']:.0f} us"
