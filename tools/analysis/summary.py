"""What people see: a live table while it runs, and the summary at its end."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.live import Live
from rich.markup import escape
from rich.table import Table

from hoap3.tools.analysis.body_findings import base_words
from hoap3.tools.analysis.certificates import in_a_line
from hoap3.tools.analysis.deadline_verdict import FAIL, NOT_JUDGED, PASS, WARN
from hoap3.tools.analysis.output import (
    COMPILING,
    CompilationMeter,
    notes,
    print_note,
    results,
    watched,
)
from hoap3.tools.analysis.verdicts import NAMES, deadline_words, in_words
from hoap3.tools.machine.stalls import limited
from hoap3.tools.services.messages import LiveFigures, LoopEvent, Message, RunStarts, StatusMessage

COLOURS = {PASS: "green", WARN: "yellow", FAIL: "red", NOT_JUDGED: "yellow"}
_IN_V = {"deg": "rad"}
"""Units of V, where errors are shown in others."""
_COLUMNS = {"n": "n", "min": "min", "p50": "p50", "p90": "p90", "p99": "p99", "p99_9": "p99.9",
            "max": "max"}  # fmt: skip


class LiveTable:
    """A table on standard error that follows the messages of a run; on a terminal only.

    Notes are lines in either case: those that matter, or all of them.

    Args:
        title: what runs.
        verbose: show all notes.
    """

    def __init__(self, title: str, *, verbose: bool = False) -> None:
        self._title, self._verbose = title, verbose
        self._told: set[str] = set()
        self._compiling = CompilationMeter()
        self._live = Live(
            console=notes, refresh_per_second=4, transient=True, redirect_stdout=False
        )
        self._watched = watched()

    def __enter__(self) -> LiveTable:
        if self._watched:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._watched:
            self._live.stop()

    def show(self, message: Message) -> None:
        """Show one message of a service or its observer."""
        match message:
            case LiveFigures() if self._watched:
                self._live.update(self._table(message.figures))
            case RunStarts(robot=robot, endpoints=at, log=log):
                print_note(f"{self._title}; robot {robot!r} at {at}; log: {log}")
            case StatusMessage(text=kernel, kind="compiling") if self._watched:
                self._live.update(f"{COMPILING}: {self._compiling.text(kernel)}")
            case StatusMessage(text=kernel, kind="compiling"):
                self._compiling.step(kernel)
            case StatusMessage(text=text, kind="not granted") if text in self._told:
                return  # the other side has said so
            case StatusMessage(text=text, kind=kind):
                if self._verbose or kind not in {"detail", "routine"}:
                    self._told.add(text)
                    print_note(text)
            case LoopEvent(text=text, routine=routine) if self._verbose or not routine:
                print_note(text)

    def _table(self, item: dict[str, Any]) -> Table:
        table = Table(title=self._title, show_header=False, box=None)
        rtt, wakeup = item.get("rtt_us", {}), item.get("wakeup_us", {})
        rows = {
            "tick": f"{item['ticks']}",
            "|e|": f"{item['error']:.3g}",
            "success, last 100": f"{item.get('success_rate', 1.0):.3f}",
            "late / lost / skipped": f"{item.get('late', 0)} / {item.get('lost', 0)} / "
            f"{item.get('skipped', 0)}",
            "RTT p50 / p99 / max": _three(rtt),
            "wake-up p50 / p99 / max": _three(wakeup),
        }
        for name, value in rows.items():
            table.add_row(name, value)
        return table


def show_summary(summary: dict[str, Any]) -> None:
    """Print the summary of a run for people, on standard output."""
    misses, rate = summary["misses"], summary["success_rate"]
    table = Table(show_header=False, box=None, pad_edge=False)
    _add_verdicts(table, summary)
    add_deadlines(table, summary)
    if summary["host_stalls"] is not None:
        stalls = summary["host_stalls"]
        told = (
            f"success rate {known(rate['outside_stalls'], '.5f')}, missed or skipped "
            f"{summary['misses_outside_stalls']}; the host stalled {stalls['n']} times, "
            f"{stalls['total_ms']:.0f} ms in all, {stalls['longest_ms']:.1f} ms at most"
        )
        table.add_row("outside stalls", "; ".join(filter(None, [told, limited(stalls)])))
    table.add_row(
        "setpoints",
        f"duplicate {misses['duplicate']}, out of order {misses['out_of_order']}, "
        f"rejected {misses['rejected']}" + _kinds(summary.get("rejections", {})),
    )
    if misses.get("conflicting"):
        told = f"{misses['conflicting']}: another client sends setpoints in the holder's name"
        table.add_row("conflicting", f"[{COLOURS[FAIL]}]{told}[/]")
    if summary.get("safe_stops"):
        table.add_row("safe stops", str(summary["safe_stops"]))
    if summary.get("interventions"):
        table.add_row(
            "interventions", f"a joint was held back in {summary['interventions']} periods"
        )
    if summary.get("torque_limited"):
        periods = summary["torque_limited"]
        table.add_row("torque limited", f"efforts were too small in {periods} periods")
    unproved = in_a_line(summary.get("certificates"))
    if unproved is not None:
        table.add_row("certificates", f"[{COLOURS[WARN]}]{escape(unproved)}[/]")
    final_error = final_error_words(summary)
    if final_error is not None:
        table.add_row("final error", final_error)
    for name, told in plant_rows(summary.get("plant"), summary["limits_and_balance"].get("base")):
        table.add_row(name, escape(told))
    if "lockstep" in summary:
        lockstep = summary["lockstep"]
        table.add_row(
            "lockstep",
            f"{lockstep['wall_s']:.2f} s, {_plain(lockstep['times_real_time'])} times real time",
        )
    if summary.get("interrupted"):
        table.add_row("ended", f"by the user, before {summary['duration_s']:g} s had passed")
    lost = [(what, why) for what in ("log", "metrics") for why in summary.get(f"{what}_lost", ())]
    for what, why in lost:
        table.add_row(f"{what} lost", f"[{COLOURS[FAIL]}]{escape(why)}[/]")
    table.add_row("log", str(summary["log"] or "none"))
    results.print(table)
    for side, value in summary.get("payload_sha256", {}).items():
        results.print(f"sha256 {side} {value}", soft_wrap=True)
    _print_durations(summary)
    results.print(machine_line(summary), markup=False)


def _print_durations(summary: dict[str, Any]) -> None:
    """The table of durations, of a run in real time."""
    if summary.get("rtt_us", {}).get("n"):
        rows = {"RTT": summary["rtt_us"], "wake-up": summary["wakeup_us"]}
        rows |= {"plant": summary.get("plant_us", {"n": 0})}
        rows |= {f"  {name}": stage for name, stage in summary["stages_us"].items()}
        results.print(durations_table(rows, summary["jitter_us"]))


def add_deadlines(table: Table, figures: dict[str, Any]) -> None:
    """Add the rows of success rate and misses."""
    misses, rate = figures["misses"], figures["success_rate"]
    table.add_row(
        "success rate",
        f"{known(rate['run'], '.5f')} of {figures['ticks']} ticks; worst window of 100: "
        f"{known(rate['worst_window'], '.2f')}",
    )
    table.add_row(
        "misses",
        f"late {misses['late']}, lost {misses['lost']}, longest run {misses['longest_run']}; "
        f"skipped ticks {figures['skipped']}",
    )


def _add_verdicts(table: Table, summary: dict[str, Any]) -> None:
    """A row for each verdict."""
    words = in_words(summary)
    for key, name in NAMES.items():
        table.add_row(name, coloured_verdict(summary["verdicts"][key], words[key]))
    late = deadline_words(summary)
    if late is not None:
        table.add_row("in time", late)


def show_next(summary: dict[str, Any], *, own_code: bool) -> None:
    """Print what can be done after a run: after a safe stop, and with its log.

    Args:
        summary: of the run.
        own_code: the controller is the user's code, which is imported on request only.
    """
    log, lead = summary["log"], "next:"
    if summary.get("safe_stops") and "lockstep" not in summary:
        print_note("next:  hoap3 run --lockstep    in virtual time, where each answer is in time")
        print_note("       hoap3 doctor            what this machine lacks for real time")
        print_note("       hoap3 recover NAME      for a robot that runs as a service: move again")
        lead = "     "
    if log is None:
        return
    folder = shlex.quote(log)
    print_note(f"{lead}  hoap3 report {folder}     a page with figures and plots")
    code = " --allow-code" if own_code else ""
    print_note(f"       hoap3 replay {folder}{code}     repeat it, and compare every setpoint")
    print_note(f"       hoap3 export {folder} --to run.csv")


def show_next_of_service(folder: Path | None, *, side: str) -> None:
    """Print how a report is written of the log of one service, and of both."""
    if folder is None:
        return
    own = shlex.quote(str(folder))
    if side == "robot":
        print_note(f"next:  hoap3 report {own}     deadlines, motion and limits")
        print_note(f"       hoap3 report {own} CONTROLLER_LOG     also the task, with both logs")
    else:
        print_note(f"next:  hoap3 report ROBOT_LOG {own}     with the folder of the robot's log")


def coloured_verdict(verdict: str, words: str = "") -> str:
    """A verdict in its colour, as rich markup, and behind it what it rests on."""
    return f"[{COLOURS[verdict]}]{verdict}[/]" + (f": {escape(words)}" if words else "")


def durations_table(rows: dict[str, dict[str, Any]], jitter: dict[str, Any]) -> Table:
    """Percentiles of durations [us], one row each, and the jitter below; empty ones left out."""
    table = Table(box=None, pad_edge=False, title="us", title_justify="left")
    table.add_column("")
    for name in _COLUMNS.values():
        table.add_column(name, justify="right")
    for name, figures in rows.items():
        if figures["n"]:
            cells = [
                f"{figures[key]:.0f}" if key == "n" else f"{figures[key]:.1f}" for key in _COLUMNS
            ]
            table.add_row(name, *cells)
    if jitter.get("n", 0) > 1:
        table.caption = (
            f"jitter: std {jitter['std']:.1f}, p99.9 - p50 {jitter['p99_9_minus_p50']:.1f}, "
            f"max {jitter['max']:.1f} us (n {jitter['n']})"
        )
        table.caption_justify = "left"
    return table


def machine_line(found: dict[str, Any]) -> str:
    """The machine that figures were measured on, and over what."""
    machine = found["machine"]
    return (
        f"{machine.get('kernel', '?')} {machine.get('preemption', '')}, "
        f"{machine.get('cores', '?')} cores, "
        f"{'virtual' if machine.get('virtual') else 'bare metal'}; {found['transport']}"
    )


def _kinds(counts: dict[str, int]) -> str:
    return f" ({', '.join(f'{name} {n}' for name, n in counts.items())})" if counts else ""


def _plain(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"


def known(value: float | None, form: str) -> str:
    """A figure, or - where there is none."""
    return "-" if value is None else format(value, form)


def _three(figures: dict[str, Any]) -> str:
    if not figures.get("n"):
        return "-"
    return f"{figures['p50']:.0f} / {figures['p99']:.0f} / {figures['max']:.0f} us"


def plant_rows(
    plant: dict[str, Any] | None, base: dict[str, Any] | None = None
) -> list[tuple[str, str]]:
    """Name and words of each row, as far as the figures of a plant and a free base are known."""
    plant = plant or {}
    rows = [("base", base_words(base))] if base else []
    if plant.get("com_m") is not None:
        com, by_model = _millimetres(plant["com_m"]), _millimetres(plant["com_by_model_m"])
        zmp = _millimetres(plant["zmp_m"]) if plant.get("zmp_m") else "none"
        text = f"CoM {com}, by the model {by_model}; ZMP {zmp} mm, seen from {plant['frame']}"
        rows.append(("plant", text))
    elif plant.get("com_world_m") is not None:
        rows.append(("plant", f"CoM {_millimetres(plant['com_world_m'])} mm in the world"))
    off = plant.get("periods_off_the_ground") or {}
    tilts = plant.get("largest_tilt_deg") or {}
    if tilts:
        each = [
            f"{sole} tilted by {tilt:.2f}° at most"
            + (f", off the ground in {off[sole]} periods" if sole in off else "")
            for sole, tilt in tilts.items()
        ]
        rows.append(("soles", "; ".join(each)))
    if plant.get("warnings"):
        counts = (f"{name} {count}" for name, count in plant["warnings"].items())
        rows.append(("plant warns", ", ".join(counts)))
    return rows


def _millimetres(place: list[float]) -> str:
    return "(" + ", ".join(f"{1e3 * value:.2f}" for value in place) + ")"


def final_error_words(summary: Mapping[str, Any]) -> str | None:
    """Format the final error √(2V), with a unit or the reason why there is none.

    V adds squares of errors in m and rad: it has a unit where all tasks share one.

    Args:
        summary: with `final_error` and the `task` that `judge` returns.

    Returns:
        None where there is nothing to tell: without V, and for 0, which is also what a controller
        sends that has none.
    """
    size = summary["final_error"]
    if not size:
        return None
    units = units_of_v(summary)
    if len(units) == 1:
        return f"{size:.3g} {units[0]}"
    without = f"{' and '.join(units)} added" if units else "in the unit of the controller's task"
    return f"{size:.3g} = √(2V), {without}"


def units_of_v(summary: Mapping[str, Any]) -> list[str]:
    """Units of what V adds: one where all tasks have it, none where one is not known.

    Args:
        summary: with the `task` that `judge` returns.
    """
    units = {_IN_V.get(error["unit"], error["unit"]) for error in summary["task"]["errors"]}
    return [] if "" in units else sorted(units)
