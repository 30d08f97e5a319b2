"""What a benchmark measured, as tables for people."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from hoap3.tools.bench.peers import missing as missing_peers
from hoap3.tools.bench.scaling import FIT_FROM
from hoap3.tools.show.output import results

COLUMNS = ("min_us", "mean_us", "p50_us", "p99_us", "max_us", "batch_mean_us")


def show_rows(rows: list[dict[str, Any]], machine: dict[str, Any]) -> None:
    """Print a row a solver on standard output, with the machine below it."""
    table = Table(title="us per call, single calls; batch_mean: median of batches of ten", box=None)
    for name in ("solver", "n", "samples"):
        table.add_column(name, justify="left" if name == "solver" else "right")
    (times,) = rows[0].keys() & {"times_qp12", "times_reference"}
    for name in (*COLUMNS, times, "paper_mean_us", "worst_error"):
        table.add_column(name.removesuffix("_us"), justify="right")
    for row in rows:
        paper, error = row.get("paper") or {}, row.get("worst_error")
        table.add_row(
            row["solver"],
            str(row["n"]),
            str(row["samples"]),
            *(f"{row[name]:.2f}" for name in COLUMNS),
            f"{row[times]:.2f}",
            f"{paper['mean_us']:.2f}" if paper else "",
            "" if error is None else f"{error:.0e}",
        )
    results.print(table)
    _show_machine(machine)


def show_general(rows: list[dict[str, Any]], machine: dict[str, Any]) -> None:
    """Print bounded and general solves, a row a solver, with how often each failed."""
    table = Table(title="us per call, single calls; constrained problems", box=None)
    failures = ("failures", "failures_at_limit")
    for name in ("solver", "n", "samples", *COLUMNS, "times_daqp", *failures):
        justify: Any = "left" if name == "solver" else "right"
        table.add_column(name.removesuffix("_us"), justify=justify)
    for row in rows:
        table.add_row(
            row["solver"],
            str(row["n"]),
            str(row["samples"]),
            *(f"{row[name]:.2f}" for name in COLUMNS),
            f"{row['times_daqp']:.2f}",
            *(_of(row[name], row[name.replace("failures", "problems")]) for name in failures),
        )
    results.print(table)
    _show_machine(machine)


def _of(failures: int | None, problems: int | None) -> str:
    return "" if failures is None else f"{failures} of {problems}"


def show_scaling(measured: dict[str, Any], machine: dict[str, Any]) -> None:
    """Print medians, a row a number of joints, and the slopes below them."""
    rows = measured["rows"]
    solvers = list(dict.fromkeys(row["solver"] for row in rows))
    medians = {(row["n"], row["solver"]): f"{row['p50_us']:.2f}" for row in rows}
    table = Table(title="median us of single calls", box=None)
    for name in ("n", *solvers):
        table.add_column(name, justify="right")
    for n in sorted({row["n"] for row in rows}):
        table.add_row(str(n), *(medians.get((n, name), "") for name in solvers))
    slopes = {name: f"{value:.2f}" for name, value in measured["slopes"].items()}
    table.add_section()
    table.add_row("slope", *(slopes.get(name, "") for name in solvers))
    results.print(table)
    results.print(f"Slopes of log(time) over log(n), from {FIT_FROM} joints on.", style="dim")
    for out in measured["left_out"]:
        text = f"Left out from {out['n']} joints on: {out['solver']}, {out['took_s']:.2g} s a call."
        results.print(text, style="dim")
    _show_machine(machine)


def show_hierarchies(measured: dict[str, Any], machine: dict[str, Any]) -> None:
    """Print what `bench_hierarchy` gives, a row a solver, and the ratios below."""
    table = Table(title="us per call, single calls; hierarchies of tasks", box=None)
    figures = ("min_us", "p50_us", "p99_us")
    for name in ("solver", "robot", "tasks", "case", "samples", *figures, "times_ghc", "active"):
        justify: Any = "left" if name in {"solver", "robot", "case"} else "right"
        table.add_column(name.removesuffix("_us"), justify=justify)
    for row in measured["rows"]:
        times, active = row["times_ghc"], row["active_mean"]
        table.add_row(
            row["solver"],
            row["robot"],
            str(row["tasks"] or ""),
            row["case"],
            str(row["samples"]),
            *(f"{row[name]:.1f}" for name in figures),
            "" if times is None else f"{times:.1f}",
            "" if active is None else f"{active:.1f}",
        )
    results.print(table)
    for row in measured["ratios"]:
        results.print(
            f"{row['robot']}, {row['tasks']} tasks, {row['case']}: {row['best_peer']} takes "
            f"{row['times_ghc']:.0f} times as long, of the shortest calls "
            f"{row['times_ghc_min']:.0f} times."
        )
    _show_machine(machine)


def show_gains(measured: dict[str, Any], machine: dict[str, Any]) -> None:
    """Print what `bench_gains` gives, a row a solver, and the ratios below."""
    table = Table(title="us per call, single calls; certified gains along a motion", box=None)
    figures = ("min_us", "p50_us", "p99_us")
    told = ("paths", "newton", "worst_gap", "worst_beta")
    for name in (
        "solver",
        "robot",
        "n",
        "joints",
        "samples",
        *figures,
        "times_sdp",
        *told,
        "failures",
    ):
        justify: Any = "left" if name in {"solver", "robot", "paths"} else "right"
        table.add_column(name.removesuffix("_us"), justify=justify)
    for row in measured["rows"]:
        paths, newton, times = row["paths"] or {}, row["newton_mean"], row["times_sdp"]
        table.add_row(
            *(str(row[name]) for name in ("solver", "robot", "n", "joints", "samples")),
            *(f"{row[name]:.1f}" for name in figures),
            "" if times is None else f"{times:.1f}",
            ", ".join(f"{name} {share:.2%}" for name, share in paths.items() if share),
            "" if newton is None else f"{newton:.1f}",
            *("" if row[name] is None else f"{row[name]:.0e}" for name in told[2:]),
            _of(row["failures"], row["problems"]),
        )
    results.print(table)
    for row in measured["ratios"]:
        results.print(
            f"{row['robot']}, {row['n']} rows, {row['joints']} joints: {row['peer']} takes "
            f"{row['times_sdp']:.0f} times as long, of the shortest calls "
            f"{row['times_sdp_min']:.0f} times."
        )
    _show_machine(machine)


def show_sampling(found: dict[str, Any]) -> None:
    """Say how long Algorithm 4 took."""
    paper = found["paper_seconds"]
    results.print(
        f"Algorithm 4 with {found['samples']:,} states of {found['robot']}: "
        f"{found['seconds']:.2f} s{f'; in the paper {paper:g} s' if paper else ''}."
    )


def show_missing(missing: dict[str, str] | None = None) -> None:
    """Say which solvers are not there, and what to install; by default of the peers of QP12."""
    for name, package in (missing_peers() if missing is None else missing).items():
        results.print(f"Not installed: {name} (pip install {package}).", style="dim")


def _show_machine(machine: dict[str, Any]) -> None:
    results.print(
        f"{machine['processor']}, {machine['cores']} cores, "
        f"{'virtual' if machine['virtual'] else 'bare metal'}, kernel {machine['kernel']}; "
        f"load {machine['load_1min']}. The maximum is the machine's, not the code's.",
        style="dim",
    )
