"""Commands that measure this machine and this code: `hoap3 doctor` and `hoap3 bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hoap3.tools.cli.options import AsJson, NoRealtime
from hoap3.tools.show.kernel_news import watch_compilation
from hoap3.tools.show.output import print_json, progress

bench_app = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="What solvers and cycles cost here."
)
Samples = Annotated[int, typer.Option(min=10, help="Calls that are timed, each on its own.")]
Calls = Annotated[
    int, typer.Option(min=10, help="Calls of each peer; ours is called 20 times as often.")
]
Pairs = Annotated[int, typer.Option(min=2, help="Runs with it, and as many without.")]
Seconds = Annotated[float, typer.Option(min=1.0, help="Of each run [s].")]


def doctor(
    as_json: AsJson = False,
    measure: Annotated[
        bool, typer.Option(help="Also time a loopback on one CPU and on two.")
    ] = True,
) -> None:
    """Say whether this machine is fit for 1 kHz, with a remedy for each finding."""
    from hoap3.tools.doctor.doctor import run_doctor

    raise typer.Exit(run_doctor(as_json, measure))


@bench_app.command("solvers")
def bench_solvers(
    joints: Annotated[int, typer.Option("-n", "--joints", min=2, help="Joints.")] = 21,
    gamma: Annotated[float, typer.Option(min=0.0, max=0.999, help="Of QP12.")] = 0.5,
    samples: Samples = 10_000,
    as_json: AsJson = False,
) -> None:
    """Time QP12 and constrained problems beside daqp, OSQP, PINV, and what else is installed."""
    from hoap3.tools.bench import general, peers, qp_peers
    from hoap3.tools.bench.show import show_general, show_rows
    from hoap3.tools.bench.solvers import bench_solvers as measure

    machine = _begin()
    with progress("bench solvers, without constraints") as meter:
        rows = measure(joints, samples, gamma, meter.part)
    fewer = max(samples // 5, 10)  # peers take up to milliseconds for each of these
    with progress("bench solvers, with constraints") as meter:
        constrained = general.bench_general(
            joints, fewer, gamma, ("feasible", "limited"), meter.part
        )
    if not as_json:
        show_rows(rows, machine)
        show_general(constrained, machine)
    absent = {**peers.missing(), **qp_peers.missing()}
    _end(as_json, {"rows": rows, "general": constrained}, machine, absent)


@bench_app.command("scaling")
def bench_scaling(
    samples: Samples = 300,
    most: Annotated[
        int, typer.Option("--most", min=7, max=1000, help="Joints of the largest problem.")
    ] = 1000,
    plot: Annotated[
        Path | None, typer.Option(help="Draw time over joints into this PNG, SVG or PDF.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Time QP12 and its peers from 7 to 1000 joints, and fit how fast each grows."""
    from hoap3.tools.bench.peers import missing
    from hoap3.tools.bench.plot import check_picture, plot_scaling
    from hoap3.tools.bench.scaling import SIZES
    from hoap3.tools.bench.scaling import bench_scaling as measure
    from hoap3.tools.bench.show import show_scaling

    if plot is not None:
        check_picture(plot)
    machine = _begin()
    with progress("bench scaling") as meter:
        measured = measure(samples, [n for n in SIZES if n <= most], report=meter.step)
    if plot is not None:
        plot_scaling(measured, machine, plot)
    if not as_json:
        show_scaling(measured, machine)
    _end(as_json, measured, machine, missing())


@bench_app.command("cycle")
def bench_cycle(
    controller: Annotated[str, typer.Option(help="Controller config: a name or a path.")] = "qp12",
    samples: Samples = 5000,
    as_json: AsJson = False,
) -> None:
    """Time one answer: kinematics, solve and integration; and all from bytes to bytes."""
    from hoap3.tools.bench.cycle import bench_cycle as measure
    from hoap3.tools.bench.show import show_rows

    machine = _begin()
    with progress("bench cycle") as meter:
        rows = measure(controller, samples, meter.part)
    if as_json:
        print_json({"rows": rows, "machine": machine})
    else:
        show_rows(rows, machine)


@bench_app.command("limits")
def bench_limits(
    samples: Samples = 5000,
    sampled: Annotated[
        int, typer.Option("--sampled", min=1, help="States that Algorithm 4 tries.")
    ] = 1_000_000,
    as_json: AsJson = False,
) -> None:
    """Time bounds of accelerations, the setpoint filter, inverse dynamics, and Algorithm 4."""
    from hoap3.tools.bench import limits
    from hoap3.tools.bench.show import show_rows, show_sampling

    machine = _begin()
    with progress("bench limits") as meter:
        rows = limits.bench_limits(samples, meter.part)
    with progress("Algorithm 4") as meter:
        sampling = limits.bench_sampling(sampled, meter.part)
    if not as_json:
        show_rows(rows, machine)
        show_sampling(sampling)
    _end(as_json, {"rows": rows, "sampling": sampling}, machine, limits.missing())


@bench_app.command("hierarchy")
def bench_hierarchy(
    samples: Calls = 200,
    quick: Annotated[
        bool, typer.Option("--quick", help="10 samples of 2 and 5 tasks: to see that it works.")
    ] = False,
    plot: Annotated[
        Path | None, typer.Option(help="Draw time over tasks into this PNG, SVG or PDF.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Time hierarchies of 1 to 7 tasks for 7 and 32 joints, beside the plain program (13)."""
    from hoap3.tools.bench.hierarchy import QUICK_TASKS, TASKS, missing
    from hoap3.tools.bench.hierarchy import bench_hierarchy as measure
    from hoap3.tools.bench.plot import check_picture, plot_hierarchies
    from hoap3.tools.bench.show import show_hierarchies

    if plot is not None:
        check_picture(plot)
    machine = _begin()
    with progress("bench hierarchy") as meter:
        calls, tasks = (10, QUICK_TASKS) if quick else (samples, TASKS)
        measured = measure(calls, tasks, report=meter.step)
    if plot is not None:
        plot_hierarchies(measured, machine, plot)
    if not as_json:
        show_hierarchies(measured, machine)
    _end(as_json, measured, machine, missing())


@bench_app.command("gains")
def bench_gains(
    samples: Calls = 200,
    robot: Annotated[
        list[str] | None,
        typer.Option(help="Whose motion: ur5, hoap3 or humanoid32; by default all, one by one."),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="10 samples along 0.2 s of ur5: to see that it works.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Time certified gains along motions of 6, 21 and 32 joints, beside conic solvers."""
    from hoap3.tools.bench.gains import MOTION_S, QUICK_ROBOTS, QUICK_S, missing
    from hoap3.tools.bench.gains import bench_gains as measure
    from hoap3.tools.bench.problems.gains_problems import MOTIONS
    from hoap3.tools.bench.show import show_gains

    machine = _begin()
    with progress("bench gains") as meter:
        calls, seconds = (10, QUICK_S) if quick else (samples, MOTION_S)
        robots = robot or (QUICK_ROBOTS if quick else list(MOTIONS))
        measured = measure(calls, robots, seconds, report=meter.step)
    if not as_json:
        show_gains(measured, machine)
    _end(as_json, measured, machine, missing())


@bench_app.command("pushes")
def bench_pushes(
    robot: Annotated[
        list[str] | None, typer.Option(help="Emulator configs; by default all, one by one.")
    ] = None,
    controller: Annotated[
        list[str] | None, typer.Option(help="Configs; by default all there are.")
    ] = None,
    direction: Annotated[
        list[int] | None, typer.Option(help="Of the push, from x [deg]; by default all eight.")
    ] = None,
    least: Annotated[
        float, typer.Option(min=0.1, max=1.4, help="Share of the bound that is tried first.")
    ] = 0.5,
    as_json: AsJson = False,
) -> None:
    """Push standing robots in MuJoCo, and compare what they survive with what is possible."""
    from hoap3.tools.bench.pushes import trials
    from hoap3.tools.bench.pushes.show import show_pushes

    machine = _begin()
    with progress("bench pushes") as meter:
        rows = trials.bench_pushes(
            robot or list(trials.TRUNKS),
            controller or (),
            direction or trials.DIRECTIONS_DEG,
            meter.step,
            least,
        )
    if not as_json:
        show_pushes(rows)
    _end(as_json, {"rows": rows}, machine, {})
    raise typer.Exit(any(row["share"] < row["wanted"] for row in rows))


@bench_app.command("clients")
def bench_clients(
    count: Annotated[int, typer.Option(min=1, help="Clients; the first one steers.")] = 20,
    rate: Annotated[
        float, typer.Option(min=1.0, max=1000.0, help="Of what each reads and sends [Hz].")
    ] = 60.0,
    apart: Annotated[
        bool, typer.Option("--apart", help="Both loops on one CPU, clients on the others.")
    ] = False,
    pairs: Pairs = 10,
    seconds: Seconds = 60.0,
    as_json: AsJson = False,
    no_realtime: NoRealtime = False,
) -> None:
    """Run UR5 in real time by turns with Python clients beside it and without any."""
    from hoap3.tools.beside.race import CLIENTS

    order = {"count": count, "rate_hz": rate}
    runs = pairs, seconds
    _race("clients", CLIENTS, order, runs, realtime=not no_realtime, as_json=as_json, apart=apart)


@bench_app.command("view")
def bench_view(
    browser: Annotated[
        Path | None,
        typer.Option(help="A Chromium that draws the page; else a client that draws nothing."),
    ] = None,
    pairs: Pairs = 10,
    seconds: Seconds = 60.0,
    as_json: AsJson = False,
    no_realtime: NoRealtime = False,
) -> None:
    """Run UR5 in real time by turns with the live page beside it and without."""
    from hoap3.tools.beside.race import PAGE
    from hoap3.tools.machine.extras import check_view

    check_view()
    order = {"browser": None if browser is None else str(browser)}
    _race("view", PAGE, order, (pairs, seconds), realtime=not no_realtime, as_json=as_json)


@bench_app.command("flood")
def bench_flood(
    rate: Annotated[
        float, typer.Option(min=1.0, max=1e6, help="Messages that a stranger sends [Hz].")
    ] = 20_000.0,
    pairs: Pairs = 10,
    seconds: Seconds = 60.0,
    as_json: AsJson = False,
    no_realtime: NoRealtime = False,
) -> None:
    """Run UR5 in real time by turns with a stranger that floods it beside it and without."""
    from hoap3.tools.beside.race import FLOOD

    order = {"rate_hz": rate}
    _race("flood", FLOOD, order, (pairs, seconds), realtime=not no_realtime, as_json=as_json)


def _race(
    name: str,
    module: str,
    order: dict[str, Any],
    runs: tuple[int, float],
    *,
    realtime: bool,
    as_json: bool,
    apart: bool = False,
) -> None:
    """Race a module, so many pairs of so many seconds, and print what came of it."""
    from hoap3.tools.beside.race import race
    from hoap3.tools.beside.show import show_race

    machine = _begin()
    with progress(f"bench {name}") as meter:
        raced = race(module, order, *runs, meter.part, realtime=realtime, apart=apart)
    if not as_json:
        show_race(raced)
    _end(as_json, raced, machine, {})


def _begin() -> dict[str, object]:
    """The machine that all is measured on; kernels that are compiled first are told."""
    from hoap3.tools.machine.machine import machine_block

    watch_compilation()
    return machine_block()


def _end(
    as_json: bool, measured: dict[str, Any], machine: dict[str, object], missing: dict[str, str]
) -> None:
    """Print all of it as JSON, or for people what could not be compared."""
    from hoap3.tools.bench.show import show_missing

    if as_json:
        print_json({**measured, "missing": list(missing), "machine": machine})
    else:
        show_missing(missing)
