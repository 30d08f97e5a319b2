"""What runs with and without something beside the robot came to, as a table for people."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from benchmarks.load.runs import CONFIDENCE, QUIET
from hoap3.tools.analysis.output import results

RUN = ("pair", "beside", "ticks", "safe_stops")
FIGURES = ("missed", "missed_outside", "rtt_p50_us", "rtt_p99_us")
COLUMNS = RUN + FIGURES


def show_race(raced: dict[str, Any]) -> None:
    """Print a row a run on standard output, and what was added below them."""
    table = Table(*COLUMNS, box=None, header_style="bold")
    for row in raced["rows"]:
        table.add_row(*(_cell(row[name]) for name in COLUMNS))
    results.print(table)
    loops, beside = (", ".join(map(str, raced["cpus"][side])) for side in ("loops", "beside"))
    results.print(f"loops on CPU {loops or 'any'}; what ran beside them on CPU {beside}")
    for what in sorted(raced["did"][0].keys() - {"failed"}):
        counts = [each[what] for each in raced["did"]]
        results.print(f"{what} of a run: {min(counts)} to {max(counts)}")
    added = raced["added"]
    for name, words in (("missed", "of all ticks"), ("missed_outside", "outside host stalls")):
        found = added[name]
        results.print(
            f"added misses, {words}: not known, as stalls were not monitored"
            if found is None
            else f"added misses, {words}: {found['mean']:.1e}, at most {found['upper']:.1e} "
            f"({CONFIDENCE:.0%}, one-sided; {added['pairs']} pairs)"
        )
    if added["alone"] is not None and added["alone"] > QUIET:
        results.print(
            f"without it {added['alone']:.1e} of the ticks were missed outside host stalls, more "
            f"than {QUIET:.0e}: this machine is too noisy now to tell what is added. Measure again"
        )
    stopped = [row["beside"] for row in raced["rows"] if row["safe_stops"]]
    if stopped:
        results.print(
            f"the robot stopped in {stopped.count(False)} runs without and {stopped.count(True)} "
            "with it. These are shorter and count as much, so the means and bounds above say little"
        )
    ratio = added["rtt_p99_ratio"]
    if ratio is not None:
        results.print(f"RTT p99: {ratio:.2f} times as long (median of the pairs)")


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.5f}" if isinstance(value, float) and value < 1.0 else f"{value:.0f}"
