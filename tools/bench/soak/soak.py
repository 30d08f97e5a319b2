"""`hoap3 soak`: a robot and its controller for hours, and what becomes of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from hoap3.protocol.config.settings import MetricsSettings
from hoap3.protocol.errors import ConfigError, Hoap3Error, UsageError
from hoap3.remote_controller.config import ControllerConfig
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.tools.analysis.deadline_verdict import FAIL, NOT_JUDGED
from hoap3.tools.analysis.output import print_line, results
from hoap3.tools.analysis.result_folder import unwritable
from hoap3.tools.analysis.summary import coloured_verdict, known, machine_line
from hoap3.tools.bench.soak.judge import CONFIDENCE, LIMIT_MB_H, judge, memory_verdict
from hoap3.tools.bench.soak.watch import Plan, Watch
from hoap3.tools.logs.files import whole_file
from hoap3.tools.machine.loopback_links import free_port
from hoap3.tools.machine.machine import machine_block
from hoap3.tools.services.configs import resolve_configs
from hoap3.tools.services.messages import LiveFigures, Message, OnMessage, RunStarts
from hoap3.tools.services.run import run_realtime, transport_words

ROTATED = ("log.cap_mb=64", "log.file_mb=8")
"""So small that the oldest file of a log goes every minute or so, within the warm-up for the first
time: with the sizes of a run nothing would be deleted in an hour and a half."""
RESULT, PICTURE = "soak.json", "soak.png"
LEAST_RANGE_MB = 2.0  # of an axis, or every page that comes and goes would fill it
COLUMNS = (
    "process",
    "RSS [MB]",
    "least",
    "most",
    "grows [MB/h]",
    "at most",
    "descriptors",
    "threads",
)


def with_metrics() -> str:
    """A setting with which a service serves metrics at a free port."""
    return f"metrics.port={free_port()}"


def soak(
    emulator: EmulatorConfig,
    controller: ControllerConfig,
    plan: Plan,
    out: Path | None,
    on_message: OnMessage,
    say: Callable[[str], None],
    files: tuple[str, str] = ("config", "config"),
    *,
    should_stop: Callable[[], bool] | None = None,
) -> dict[str, Any]:
    """Run both services, watch them, and say what they came to.

    Args:
        emulator, controller: settings of both, with metrics.
        plan: how long.
        out: folder of logs and results, or None for a new one below the configured directory.
        on_message: receives each message of the services and their observers.
        say: takes how far it is, now and then.
        files: names of both configs, for errors.
        should_stop: as for `run_realtime`.

    Returns:
        What `judge` gives, and `plan`, `failure`, `interrupted`, `machine`, `transport`, `run` (its
        summary, None where it failed), and `files`, what was written.

    Raises:
        Hoap3Error: the robot did not come to move, or the results cannot be written.
    """
    if not emulator.log.record:
        raise ConfigError(
            files[0], "log.record", False, "a soak is of services that record", "Leave it out"
        )
    doors = {
        "robot": _door(emulator.metrics, files[0]),
        "controller": _door(controller.metrics, files[1]),
    }
    _, description = resolve_configs(emulator, controller, files)
    watch = Watch(plan, doors, round(description.period_s * 1e9), say)
    places: list[str] = []

    def receive(message: Message) -> None:
        if isinstance(message, RunStarts):
            places.append(message.log)
        elif isinstance(message, LiveFigures):
            watch.receive(message.figures)
        on_message(message)

    summary: dict[str, Any] | None = None
    failure = ""
    try:
        summary = run_realtime(
            emulator,
            controller,
            plan.duration_s,
            out,
            receive,
            files,
            should_stop=should_stop,
            meanwhile=watch.look,
        )
    except UsageError:
        raise
    except Hoap3Error as error:  # what ends a service after hours is what a soak is to find
        if not watch.began:
            raise
        failure = str(error)
    result = {
        **judge(watch, plan.warm_up_s, summary, emulator.log.cap_mb * 1_000_000),
        "plan": {"duration_s": plan.duration_s, "warm_up_s": plan.warm_up_s},
        "interrupted": summary is not None and summary["interrupted"],
        "failure": failure,
        "machine": machine_block() if summary is None else summary["machine"],
        "transport": transport_words(emulator.link),
        "run": summary,
    }
    return {**result, "files": [str(path) for path in _write(result, watch, Path(places[0]))]}


def _door(metrics: MetricsSettings, file: str) -> tuple[str, int]:
    """Host and port of the metrics of a service."""
    if metrics.port is None:
        raise ConfigError(
            file, "metrics.port", None, "a soak asks each service for metrics", "Leave it out"
        )
    return metrics.host, metrics.port


def _write(result: dict[str, Any], watch: Watch, folder: Path) -> list[Path]:
    """Write figures and picture into the folder of the logs."""
    report, picture = folder / RESULT, folder / PICTURE
    try:
        with whole_file(report) as draft:
            draft.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
        with whole_file(picture) as draft:
            draw(watch, result, draft)
    except OSError as error:
        raise unwritable(folder, error) from error
    return [report, picture]


def draw(watch: Watch, result: dict[str, Any], path: Path) -> None:
    """Draw a panel a process, all of the soak, the warm-up shaded, as a PNG.

    Raises:
        OSError: the picture cannot be written.
    """
    from matplotlib.figure import Figure

    seen = {pid: rounds.since(0.0) for pid, rounds in watch.processes.items()}
    memory = {each["pid"]: each["memory"] for each in result["processes"]}
    rows = max(len(seen), 1)  # none where it ended before the first round
    figure = Figure(figsize=(8, 1.2 + 1.3 * rows), layout="constrained")
    panels = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for axes, (pid, held) in zip(panels, seen.items(), strict=False):
        rss = held["rss_bytes"] / 1e6
        axes.plot(held["t"] / 60, rss, linewidth=1.0)
        half = max(LEAST_RANGE_MB, 1.1 * (rss.max() - rss.min())) / 2
        middle = (rss.max() + rss.min()) / 2
        axes.set_ylim(middle - half, middle + half)
        axes.axvspan(0.0, result["plan"]["warm_up_s"] / 60, color="0.9")
        title = watch.processes[pid].label + _growth(memory.get(pid))
        axes.set_title(title, size=9, loc="left")
        axes.grid(alpha=0.25)
    panels[-1].set_xlabel("time since the robot began to move [min]; grey: warm-up")
    figure.supylabel("resident memory [MB]", size=9)
    machine = result["machine"]
    figure.suptitle(f"{machine['processor']}, kernel {machine['kernel']}", size=9)
    figure.savefig(path, dpi=120, format="png")


def _growth(memory: dict[str, Any] | None) -> str:
    """How fast it grows, where that is known."""
    if memory is None or memory["upper_mb_per_hour"] is None:
        return ""
    slope, upper = memory["slope_mb_per_hour"], memory["upper_mb_per_hour"]
    return f": {slope:+.2f} MB/h, at most {upper:+.2f}"


def show_soak(soaked: dict[str, Any]) -> None:
    """Print a row a process, a verdict a figure, and where the files are."""
    table = Table(*COLUMNS, box=None, header_style="bold", pad_edge=False)
    for each in soaked["processes"]:
        memory = each["memory"]
        table.add_row(
            escape(each["name"]),
            f"{memory['begin_mb']:.1f} → {memory['end_mb']:.1f}",
            f"{memory['min_mb']:.1f}",
            f"{memory['max_mb']:.1f}",
            known(memory["slope_mb_per_hour"], "+.3f"),
            known(memory["upper_mb_per_hour"], "+.3f"),
            _counts(each["descriptors"]),
            _counts(each["threads"]),
        )
    results.print(table)
    rows = Table(show_header=False, box=None, pad_edge=False)
    for name, words in in_words(soaked).items():
        rows.add_row(name, coloured_verdict(soaked["verdicts"][name], words))
    rows.add_row("all in all", coloured_verdict(soaked["verdict"]))
    results.print(rows)
    if soaked["interrupted"]:
        print_line(
            f"ended by the user, before {soaked['plan']['duration_s'] / 60:g} min had passed"
        )
    if soaked["failure"]:
        print_line(f"the services failed: {soaked['failure']}")
    results.print(machine_line(soaked), markup=False)
    for file in soaked["files"]:
        print_line(file)


def in_words(soaked: dict[str, Any]) -> dict[str, str]:
    """What each verdict rests on, in a line."""
    measured, processes = soaked["measured"], soaked["processes"]
    log, metrics = soaked["log"], soaked["metrics"]
    there = sum(each["throughout"] for each in processes)
    sizes = ", ".join(f"{side} {known(mb, '.1f')}" for side, mb in log["most_mb"].items())
    dropped = ", ".join(f"{side} {known(n, 'd')}" for side, n in log["dropped"].items())
    lost = "".join(f"; {why}" for why in log["lost"])
    return {
        "memory": _memory_words(processes),
        "descriptors": _changed(processes, "descriptors"),
        "threads": _changed(processes, "threads"),
        "processes": f"{there} of {len(processes)} were there in all {measured['rounds']} rounds",
        "phase": _phase_words(soaked["phase"]),
        "deadlines": _deadline_words(soaked["deadlines"]),
        "log": f"at most {sizes} MB of {log['cap_mb']:g}; records dropped: {dropped}{lost}",
        "metrics": f"asked for {metrics['asked']} times, {metrics['unanswered']} in vain",
    }


def _memory_words(processes: list[dict[str, Any]]) -> str:
    limit = f"{LIMIT_MB_H:g} MB/h with {CONFIDENCE:.0%} confidence"
    by_verdict = {
        verdict: [each["name"] for each in processes if memory_verdict(each["memory"]) == verdict]
        for verdict in (FAIL, NOT_JUDGED)
    }
    if by_verdict[FAIL]:
        return f"grows by more than {limit}: {', '.join(by_verdict[FAIL])}"
    if by_verdict[NOT_JUDGED] or not processes:
        which = f": {', '.join(by_verdict[NOT_JUDGED])}" if processes else ""
        return f"too short to tell whether growth is below {limit}{which}"
    return f"every process grows by less than {limit}"


def _phase_words(phase: dict[str, Any]) -> str:
    words = f"the schedule moved by {phase['drift_ns']} ns in {phase['states']} States"
    if phase["wakeup_mean_us"] is None:
        return words
    return f"{words}; woke {phase['wakeup_mean_us']:.1f} µs late on average"


def _deadline_words(found: dict[str, Any]) -> str:
    stops = f"safe stops {known(found['safe_stops'], 'd')}"
    if found["success_rate"] is None:
        return f"{found['text']} in the measured time; {stops}"
    words = (
        f"{found['text']}; success rate {found['success_rate']:.6f} of {found['ticks']} ticks: "
        f"late {found['late']}, lost {found['lost']}, skipped {found['skipped']}"
    )
    if found["success_rate_outside_stalls"] is not None:
        words += (
            f"; outside stalls {found['success_rate_outside_stalls']:.6f}, missed or skipped "
            f"{found['missed_outside_stalls']}; the host stalled {found['host_stalls']} times, "
            f"{found['host_stall_seconds']:.2f} s in all"
        )
    return (
        f"{words}; of the whole run: worst window of 100 {known(found['worst_window'], '.2f')}, "
        f"{stops}"
    )


def _changed(processes: list[dict[str, Any]], what: str) -> str:
    changed = [
        f"{each['name']} {each[what]['begin']} → {each[what]['end']}"
        for each in processes
        if each[what]["begin"] != each[what]["end"]
    ]
    return ", ".join(changed) or "as many at the end as at the begin"


def _counts(found: dict[str, int]) -> str:
    return f"{found['begin']} → {found['end']} ({found['min']} to {found['max']})"
