"""Commands that measure: `bench`, `compare`, `doctor`, `latency`, `limits`, `reproduce`, `soak`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from hoap3.protocol.errors import UsageError
from hoap3.remote_controller.pairs import DEFAULT_CONFIG
from hoap3.tools.analysis.output import Meter, print_json, print_note, progress, watch_compilation
from hoap3.tools.cli.options import (
    AsJson,
    NoRealtime,
    RobotConfig,
    RunController,
    RunRobot,
    Sets,
    Verbose,
    finite,
)
from hoap3.tools.machine.processes import StopFlag

bench_app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Measure computing times of solvers and cycles.",
)
Samples = Annotated[int, typer.Option(min=10, help="Number of calls to time.")]


def doctor(
    as_json: AsJson = False,
    measure: Annotated[
        bool, typer.Option(help="Also measure a loopback on one CPU and on two.")
    ] = True,
) -> None:
    """Check whether this machine is fit for 1 kHz, with a remedy for each finding."""
    from hoap3.tools.bench.doctor.doctor import run_doctor

    raise typer.Exit(run_doctor(as_json, measure))


@bench_app.command("solvers")
def bench_solvers(
    joints: Annotated[int, typer.Option("-n", "--joints", min=2, help="Number of joints.")] = 21,
    gamma: Annotated[
        float, typer.Option(min=0.0, max=0.999, help="Parameter gamma of QP12.")
    ] = 0.5,
    samples: Samples = 10_000,
    as_json: AsJson = False,
) -> None:
    """Time QP12 by our solver, daqp, OSQP and PINV."""
    from hoap3.tools.bench.case_runner import run_benchmark
    from hoap3.tools.bench.show import show_rows
    from hoap3.tools.bench.solvers import bench_solvers as measure

    run_benchmark(
        progress("bench solvers"),
        lambda meter: {"rows": measure(joints, samples, gamma, meter.part)},
        show_rows,
        as_json=as_json,
    )


@bench_app.command("cycle")
def bench_cycle(
    controller: Annotated[str, typer.Option(help="Controller config: a name or a path.")] = "qp12",
    samples: Samples = 5000,
    as_json: AsJson = False,
) -> None:
    """Time one answer: kinematics, solver, integration, and the whole cycle."""
    from hoap3.tools.bench.case_runner import run_benchmark
    from hoap3.tools.bench.cycle import bench_cycle as measure
    from hoap3.tools.bench.show import show_rows

    run_benchmark(
        progress("bench cycle"),
        lambda meter: {"rows": measure(controller, samples, meter.part)},
        show_rows,
        as_json=as_json,
    )


def latency(
    log: Annotated[
        Path | None, typer.Option(help="Analyse the log of a run instead of measuring.")
    ] = None,
    link: Annotated[
        Literal["tcp", "udp", "unixsock", "tls", "hoap3_tcp"],
        typer.Option(help="Link to measure; tls uses certificates, and alternates with tcp."),
    ] = "tcp",
    robot: RobotConfig = "hoap3",
    blocks: Annotated[
        int, typer.Option(min=1, help="Number of blocks of Zenoh, and of the echo.")
    ] = 5,
    ticks: Annotated[int, typer.Option(min=100, help="Ticks per block.")] = 2000,
    out: Annotated[
        Path | None, typer.Option(help="New folder for the logs; default: they are not kept.")
    ] = None,
    no_realtime: Annotated[
        bool, typer.Option("--no-realtime", help="Do not pin to a CPU or raise the priority.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Measure the link with a controller that computes nothing, and a bare TCP echo."""
    stop = StopFlag()
    from hoap3.tools.analysis.verdicts import failed
    from hoap3.tools.bench.case_runner import run_benchmark
    from hoap3.tools.bench.latency.latency import Plan, analyse_log, measure_latency, show_latency
    from hoap3.tools.services.configs import load_emulator_config

    def measure(meter: Meter) -> dict[str, Any]:
        if log is not None:
            return analyse_log(log)
        emulator, _ = load_emulator_config(robot, [], realtime=not no_realtime)
        plan = Plan(emulator, link, blocks, ticks, realtime=not no_realtime, out=out)
        return measure_latency(plan, meter.step, stop)

    found = run_benchmark(progress("latency"), measure, show_latency, as_json=as_json)
    raise typer.Exit(1 if failed(found["verdicts"]) else 0)


def limits(
    robot: Annotated[str, typer.Argument(help="Robot or emulator config: a name or a path.")],
    samples: Annotated[int, typer.Option(min=1, help="Number of random states.")] = 1_000_000,
    velocities: Annotated[
        Literal["corners", "uniform"],
        typer.Option(help="Joint velocities: all at their limits, or uniform."),
    ] = "corners",
    polish: Annotated[
        int, typer.Option(min=0, help="Number of worst states of each bound to search around.")
    ] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random states.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Compute the joint accelerations that torque limits permit in the worst state."""
    watch_compilation()
    from hoap3.tools.robots.sampled_limits import sample, show

    with progress(f"states of {robot}") as meter:
        found = sample(robot, samples, velocities, polish, seed, meter.part)
    if as_json:
        print_json(found)
    else:
        show(found)
    raise typer.Exit(1 if found["findings"] else 0)


def compare(
    controllers: Annotated[
        list[str],
        typer.Argument(
            metavar="[LABEL=]CONTROLLER[@KEY=VALUE,…]",
            help="At least two, as for `run --controller`, each with changed parameters or none.",
        ),
    ],
    log: Annotated[
        Path | None,
        typer.Option("--log", metavar="LOG", help="Answer the States of this log; no robot moves."),
    ] = None,
    robot: Annotated[
        str | None, typer.Option(help="Robot or emulator config; default: hoap3.")
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(min=0.001, callback=finite, help="Duration of the motion [s]; default: 20."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of all random numbers; default: 0.")
    ] = None,
    timing: Annotated[
        bool, typer.Option("--timing/--no-timing", help="Also measure how long answers take.")
    ] = True,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for the files; default: a new one in compared/."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare controllers, each on a robot in lockstep, or on the States of a log."""
    from hoap3.tools.machine.machine import check_extra

    check_extra("report")
    watch_compilation()
    from hoap3.tools.analysis.compare.comparison import compare as make
    from hoap3.tools.analysis.compare.output import RESULT, show, write
    from hoap3.tools.analysis.result_folder import make_folder, new_name

    folder = out or new_name(Path("compared"))
    with progress("compare") as meter:
        made = make(
            controllers,
            robot,
            duration,
            seed,
            log,
            timing=timing,
            say=meter.step,
            ready=lambda: make_folder(folder, RESULT),
        )
        files = write(made, folder)
    if as_json:
        names = [str(path) for path in files]
        print_json({**made.as_json(), "timing": made.timing, "files": names})
    else:
        show(made, files)
    raise typer.Exit(1 if made.findings else 0)


def reproduce(
    paper: Annotated[str, typer.Argument(help="Name of the paper: bounds, ghc, qp12 or sdp.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", help="Folder for the files; default: a new one in reproduced/PAPER/."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Reproduce a paper's figures and tables, and compare them with its equations."""
    from hoap3.tools.machine.machine import check_extra

    check_extra("report")
    watch_compilation()
    from hoap3.tools.reproduce.remake import reproduce as remake
    from hoap3.tools.reproduce.show import show_rows

    with progress(f"reproduce {paper}") as meter:
        made = remake(paper, out, meter.step)
    if as_json:
        print_json(made.as_json())
    else:
        show_rows(made)
    raise typer.Exit(0 if made.passed else 1)


MINUTES = 90.0
WARM_UP, WARM_UP_MIN = 1 / 9, 10.0  # of the whole, and at most


def soak(
    hours: Annotated[
        float | None, typer.Option(min=0.001, callback=finite, help="Duration [h].")
    ] = None,
    minutes: Annotated[
        float | None,
        typer.Option(min=0.05, callback=finite, help=f"Duration [min]; default: {MINUTES:g}."),
    ] = None,
    warm_up_minutes: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            callback=finite,
            help="Start of the run that is not measured [min]; default: 1/9 of it, at most 10.",
        ),
    ] = None,
    robot: RunRobot = None,
    controller: RunController = DEFAULT_CONFIG,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for logs and results; default: a new one in logs/."),
    ] = None,
    as_json: AsJson = False,
    no_realtime: NoRealtime = False,
    verbose: Verbose = False,
    sets: Sets = [],  # noqa: B006 - typer's own way
) -> None:
    """Run robot and controller for hours; check memory, descriptors, threads, phase, deadlines."""
    stop = StopFlag()
    from hoap3.tools.machine.machine import check_extra

    check_extra("report")
    check_extra("metrics")
    watch_compilation()
    from hoap3.tools.analysis.summary import LiveTable
    from hoap3.tools.bench.case_runner import run_benchmark
    from hoap3.tools.bench.soak.soak import ROTATED, show_soak, with_metrics
    from hoap3.tools.bench.soak.soak import soak as run_soak
    from hoap3.tools.bench.soak.watch import Plan
    from hoap3.tools.services.configs import load_pair

    whole = _minutes(hours, minutes)
    warm_up = min(WARM_UP * whole, WARM_UP_MIN) if warm_up_minutes is None else warm_up_minutes
    plan = Plan(60 * whole, 60 * warm_up)
    more = [*ROTATED, with_metrics()], [with_metrics()]
    emulator, law, files = load_pair(robot, controller, sets, more, realtime=not no_realtime)
    title = f"soak of {Path(emulator.robot).name} with {controller}, {whole:g} min"
    soaked = run_benchmark(
        LiveTable(title, verbose=verbose),
        lambda table: run_soak(
            *(emulator, law, plan, out, table.show, print_note, files),
            should_stop=stop,
        ),
        show_soak,
        as_json=as_json,
    )
    raise typer.Exit(0 if soaked["verdict"] == "pass" else 1)


def _minutes(hours: float | None, minutes: float | None) -> float:
    """How long it takes, by the one option that says so."""
    if hours is not None and minutes is not None:
        raise UsageError("--hours and --minutes: give one of them")
    if hours is not None:
        return 60 * hours
    return MINUTES if minutes is None else minutes
