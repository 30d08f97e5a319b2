"""`python -m benchmarks.solvers`: `hoap3 bench solvers` with all solvers that are installed."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from benchmarks import qp12_peers, qp_peers
from benchmarks.command import main, show_missing
from benchmarks.general import bench_general
from hoap3.tools.analysis.output import Meter, progress
from hoap3.tools.bench.case_runner import run_benchmark
from hoap3.tools.bench.show import COLUMNS, SINGLE, numbers, show_rows, show_table, words
from hoap3.tools.bench.solvers import GAMMA, bench_solvers
from hoap3.tools.cli.options import AsJson


def missing() -> dict[str, str]:
    """Solvers that are not installed, and their packages."""
    return qp12_peers.missing() | qp_peers.missing()


def show(measured: dict[str, Any]) -> None:
    """Print a row a solver, then constrained problems with how often each solver failed."""
    show_rows(measured)

    def cells(row: dict[str, Any]) -> dict[str, str]:
        return {
            **words(row, "solver", "n", "samples"),
            **numbers(row, ".2f", *COLUMNS, "times_daqp"),
            "failures": _of(row["failures"], row["problems"]),
            "failures_at_limit": _of(row["failures_at_limit"], row["problems_at_limit"]),
        }

    show_table(f"{SINGLE}constrained problems", measured["general"], cells, measured["machine"])
    show_missing(missing())


def _of(failures: int | None, problems: int | None) -> str:
    return "" if failures is None else f"{failures} of {problems}"


def command(
    joints: Annotated[int, typer.Option("-n", "--joints", min=2, help="Joints.")] = 21,
    gamma: Annotated[float, typer.Option(min=0.0, max=0.999, help="Of QP12.")] = GAMMA,
    samples: Annotated[int, typer.Option(min=10, help="Single calls.")] = 10_000,
    as_json: AsJson = False,
) -> None:
    """Time QP12 and constrained problems by all solvers that are installed."""
    fewer = max(samples // 5, 10)  # peers take up to milliseconds for each of these

    def measure(meter: Meter) -> dict[str, Any]:
        plain = {name: qp12_peers.PEERS[name] for name in qp12_peers.installed()}
        return {
            "rows": bench_solvers(joints, samples, gamma, meter.part, plain),
            "general": bench_general(joints, fewer, gamma, qp_peers.installed(), meter.part),
            "missing": list(missing()),
        }

    run_benchmark(progress("solvers"), measure, show, as_json=as_json)


if __name__ == "__main__":
    main(command)
