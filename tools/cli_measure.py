"""Commands that measure this machine and this code: `hoap3 doctor` and `hoap3 bench`."""

from __future__ import annotations

import json
import sys
from typing import Annotated, Any

import typer

bench_app = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="What solvers and cycles cost here."
)
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")]
Samples = Annotated[int, typer.Option(min=10, help="Calls that are timed, each on its own.")]


def doctor(
    as_json: AsJson = False,
    measure: Annotated[
        bool, typer.Option(help="Also time a loopback on one CPU and on two.")
    ] = True,
) -> None:
    """Say whether this machine is fit for 1 kHz, with a remedy for each finding."""
    from tools.doctor import run_doctor

    raise typer.Exit(run_doctor(as_json, measure))


@bench_app.command("solvers")
def bench_solvers(
    joints: Annotated[int, typer.Option("-n", "--joints", min=2, help="Joints.")] = 21,
    gamma: Annotated[float, typer.Option(min=0.0, max=1.0, help="Of QP12.")] = 0.5,
    samples: Samples = 10_000,
    as_json: AsJson = False,
) -> None:
    """Time QP12 beside its peers: daqp, OSQP, PINV, and quadprog and ProxQP where installed."""
    from tools.bench.solvers import bench_solvers as measure

    _show(measure(joints, samples, gamma), as_json)


@bench_app.command("cycle")
def bench_cycle(
    controller: Annotated[str, typer.Option(help="Controller config: a name or a path.")] = "qp12",
    samples: Samples = 5000,
    as_json: AsJson = False,
) -> None:
    """Time one answer: kinematics, solve and integration; and all from bytes to bytes."""
    from tools.bench.cycle import bench_cycle as measure

    _show(measure(controller, samples), as_json)


def _show(rows: list[dict[str, Any]], as_json: bool) -> None:
    from tools.bench.show import show_rows
    from tools.machine import machine_block

    machine = machine_block()
    if as_json:
        sys.stdout.write(json.dumps({"rows": rows, "machine": machine}, indent=2) + "\n")
    else:
        show_rows(rows, machine)
