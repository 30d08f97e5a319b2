"""What a benchmark measured, as tables for people."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rich.table import Table

from hoap3.tools.bench.scaling import FIT_FROM
from hoap3.tools.show.output import results

Row = dict[str, Any]

COLUMNS = ("min_us", "mean_us", "p50_us", "p99_us", "max_us", "batch_mean_us")
FEWER = ("min_us", "p50_us", "p99_us")
SINGLE = "us per call, single calls; "
LEFT = {"solver", "robot", "case", "paths"}
"""Columns of words; all others are numbers."""


def show_rows(rows: list[Row], machine: Row) -> None:
    """Print a row a solver on standard output, with the machine below it."""
    (times,) = rows[0].keys() & {"times_qp12", "times_reference"}

    def cells(row: Row) -> dict[str, str]:
        paper = (row.get("paper") or {}).get("mean_us")
        return {
            **_words(row, "solver", "n", "samples"),
            **_numbers(row, ".2f", *COLUMNS, times),
            "paper_mean": _number(paper, ".2f"),
            "worst_error": _number(row.get("worst_error"), ".0e"),
        }

    _show(f"{SINGLE}batch_mean: median of batches of ten", rows, cells)
    _show_machine(machine)


def show_general(rows: list[Row], machine: Row) -> None:
    """Print bounded and general solves, a row a solver, with how often each failed."""

    def cells(row: Row) -> dict[str, str]:
        return {
            **_words(row, "solver", "n", "samples"),
            **_numbers(row, ".2f", *COLUMNS, "times_daqp"),
            "failures": _of(row["failures"], row["problems"]),
            "failures_at_limit": _of(row["failures_at_limit"], row["problems_at_limit"]),
        }

    _show(f"{SINGLE}constrained problems", rows, cells)
    _show_machine(machine)


def show_scaling(measured: Row, machine: Row) -> None:
    """Print medians, a row a number of joints, and the slopes below them."""
    rows = measured["rows"]
    solvers = list(dict.fromkeys(row["solver"] for row in rows))
    medians = {(row["n"], row["solver"]): row["p50_us"] for row in rows}
    lines: list[tuple[Any, Row]] = [
        (n, {name: medians.get((n, name)) for name in solvers})
        for n in sorted({row["n"] for row in rows})
    ]
    lines.append(("slope", {name: measured["slopes"].get(name) for name in solvers}))
    _show(
        "median us of single calls",
        lines,
        lambda line: {"n": str(line[0]), **_numbers(line[1], ".2f", *solvers)},
    )
    results.print(f"Slopes of log(time) over log(n), from {FIT_FROM} joints on.", style="dim")
    for out in measured["left_out"]:
        text = f"Left out from {out['n']} joints on: {out['solver']}, {out['took_s']:.2g} s a call."
        results.print(text, style="dim")
    _show_machine(machine)


def show_hierarchies(measured: Row, machine: Row) -> None:
    """Print what `bench_hierarchy` gives, a row a solver, and the ratios below."""

    def cells(row: Row) -> dict[str, str]:
        return {
            **_words(row, "solver", "robot", "tasks", "case", "samples"),
            **_numbers(row, ".1f", *FEWER, "times_ghc"),
            "active": _number(row["active_mean"], ".1f"),
        }

    _show(f"{SINGLE}hierarchies of tasks", measured["rows"], cells)
    for row in measured["ratios"]:
        what = f"{row['robot']}, {row['tasks']} tasks, {row['case']}: {row['best_peer']}"
        _show_ratio(what, row["times_ghc"], row["times_ghc_min"])
    _show_machine(machine)


def show_gains(measured: Row, machine: Row) -> None:
    """Print what `bench_gains` gives, a row a solver, and the ratios below."""

    def cells(row: Row) -> dict[str, str]:
        paths = (row["paths"] or {}).items()
        return {
            **_words(row, "solver", "robot", "n", "joints", "samples"),
            **_numbers(row, ".1f", *FEWER, "times_sdp"),
            "paths": ", ".join(f"{name} {share:.2%}" for name, share in paths if share),
            "newton": _number(row["newton_mean"], ".1f"),
            **_numbers(row, ".0e", "worst_gap", "worst_beta"),
            "failures": _of(row["failures"], row["problems"]),
        }

    _show(f"{SINGLE}certified gains along a motion", measured["rows"], cells)
    for row in measured["ratios"]:
        what = f"{row['robot']}, {row['n']} rows, {row['joints']} joints: {row['peer']}"
        _show_ratio(what, row["times_sdp"], row["times_sdp_min"])
    _show_machine(machine)


def show_sampling(found: Row) -> None:
    """Say how long Algorithm 4 took."""
    paper = found["paper_seconds"]
    results.print(
        f"Algorithm 4 with {found['samples']:,} states of {found['robot']}: "
        f"{found['seconds']:.2f} s{f'; in the paper {paper:g} s' if paper else ''}."
    )


def show_missing(missing: dict[str, str]) -> None:
    """Say which solvers are not there, and what to install: name to package."""
    for name, package in missing.items():
        results.print(f"Not installed: {name} (pip install {package}).", style="dim")


def _show(title: str, rows: list[Any], cells: Callable[[Any], dict[str, str]]) -> None:
    """Print a table; `cells` gives what a row has in each column, by the column's name."""
    table = Table(title=title, box=None)
    for name in cells(rows[0]):
        table.add_column(name, justify="left" if name in LEFT else "right")
    for row in rows:
        table.add_row(*cells(row).values())
    results.print(table)


def _words(row: Row, *names: str) -> dict[str, str]:
    return {name: str(row[name] or "") for name in names}


def _numbers(row: Row, form: str, *names: str) -> dict[str, str]:
    return {name.removesuffix("_us"): _number(row[name], form) for name in names}


def _number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def _of(failures: int | None, problems: int | None) -> str:
    return "" if failures is None else f"{failures} of {problems}"


def _show_ratio(what: str, times: float, least: float) -> None:
    results.print(
        f"{what} takes {times:.0f} times as long, of the shortest calls {least:.0f} times."
    )


def _show_machine(machine: Row) -> None:
    results.print(
        f"{machine['processor']}, {machine['cores']} cores, "
        f"{'virtual' if machine['virtual'] else 'bare metal'}, kernel {machine['kernel']}; "
        f"load {machine['load_1min']}. The maximum is the machine's, not the code's.",
        style="dim",
    )
