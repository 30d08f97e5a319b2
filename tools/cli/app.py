"""The command line. It only wires: what a command does stands in a module of its own.

Results go to standard output, with `--json` as one JSON object; notes, progress and errors go to
standard error. Exit codes: 0 no verdict fails, 1 findings, 2 wrong usage or settings.
"""

from __future__ import annotations

import json
import re
import sys
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer

from hoap3.protocol.errors import (
    ConfigError,
    LogError,
    UsageError,
)
from hoap3.protocol.former_names import check_command_line
from hoap3.remote_controller.pairs import DEFAULT_CONFIG
from hoap3.tools.analysis.output import (
    print_json,
    print_line,
    print_note,
    print_result,
    progress,
    watch_compilation,
)
from hoap3.tools.cli.help import LIGHT, NEEDED_MB, GroupedCommands, show_help
from hoap3.tools.cli.logs import report, verify
from hoap3.tools.cli.measurements import (
    bench_app,
    compare,
    doctor,
    latency,
    limits,
    reproduce,
    soak,
)
from hoap3.tools.cli.operation import certs_app, service_app
from hoap3.tools.cli.options import (
    ENDPOINT,
    AllowCode,
    AsJson,
    Connect,
    LockJoints,
    LogPath,
    NoRealtime,
    RunController,
    Running,
    RunRobot,
    Secure,
    Sets,
    Tip,
    Verbose,
    finite,
    reached,
    with_secure,
)
from hoap3.tools.cli.preparation import new, robot_app, trajectory_app
from hoap3.tools.cli.requests import change, place_of, show_answers
from hoap3.tools.cli.viewers import bridge_app, view
from hoap3.tools.machine.processes import (
    StopFlag,
    check_libraries,
    check_memory,
    run_program,
    to_people,
)

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)
config_app = typer.Typer(no_args_is_help=True, help="Show, check and describe configs.")
app.add_typer(config_app, name="config")
app.add_typer(bench_app, name="bench")
app.add_typer(bridge_app, name="bridge")
app.add_typer(certs_app, name="certs")
app.add_typer(robot_app, name="robot")
app.add_typer(service_app, name="service")
app.add_typer(trajectory_app, name="trajectory")
_COMMANDS = (
    *(change, compare, doctor, latency, limits, new, report, reproduce, soak, verify, view),
)
for command in _COMMANDS:
    app.command()(command)
app.command("help")(show_help)


Duration = Annotated[
    float | None,
    typer.Option(min=0.001, callback=finite, help="Duration [s]; default: until it is stopped."),
]
Out = Annotated[
    Path | None, typer.Option("--out", help="Folder for the log; default: a new one in logs/.")
]


@app.command()
def run(
    robot: RunRobot = None,
    controller: RunController = DEFAULT_CONFIG,
    duration: Annotated[
        float, typer.Option(min=0.001, callback=finite, help="Duration of the motion [s].")
    ] = 5.0,
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="Run in virtual time, in one process.")
    ] = False,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of all random numbers.")] = None,
    out: Out = None,
    as_json: AsJson = False,
    no_realtime: NoRealtime = False,
    verbose: Verbose = False,
    sets: Sets = [],  # noqa: B006 - typer's own way
    tip: Tip = None,
    lock_joints: LockJoints = [],  # noqa: B006
) -> None:
    """Run a robot and its controller; --set takes emulator.KEY=VALUE and controller.KEY=VALUE."""
    check_memory(None if lockstep else NEEDED_MB["emulator"])
    watch_compilation()
    from hoap3.tools.analysis.summary import LiveTable, show_next, show_summary
    from hoap3.tools.analysis.verdicts import failed
    from hoap3.tools.services.configs import load_pair
    from hoap3.tools.services.run import run_lockstep, run_realtime

    stop = StopFlag()
    parts = {"seed": seed, "tip": tip or None, "lock_joints": lock_joints or None}
    sets = sets + [
        f"emulator.{key}={json.dumps(each, ensure_ascii=False)}"
        for key, each in parts.items()
        if each is not None
    ]
    emulator, law, files = load_pair(robot, controller, sets, realtime=not no_realtime)
    title = f"{Path(emulator.robot).name} with {controller}, {duration:g} s"
    if lockstep:
        with progress(f"{title} in lockstep") as meter:
            summary = run_lockstep(
                emulator, law, duration, out, files, should_stop=stop, report=meter.part
            )
    else:
        with LiveTable(title, verbose=verbose) as table:
            summary = run_realtime(
                emulator, law, duration, out, table.show, files, should_stop=stop
            )
    if as_json:
        print_json(summary)
    else:
        show_summary(summary)
        show_next(summary, own_code=":" in law.controller)
    bad = failed(summary["verdicts"]) or summary["log_lost"] or summary["metrics_lost"]
    raise typer.Exit(1 if bad else 0)


@app.command()
def emulator(
    config: Annotated[str, typer.Argument(help="Emulator config or robot: a name or a path.")],
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="Use virtual time over Zenoh.")
    ] = False,
    duration: Duration = None,
    out: Out = None,
    as_json: AsJson = False,
    no_realtime: NoRealtime = False,
    verbose: Verbose = False,
    sets: Sets = [],  # noqa: B006
    secure: Secure = None,
    insecure: Annotated[
        bool,
        typer.Option("--insecure", help="Listen beyond this machine without certificates."),
    ] = False,
) -> None:
    """Emulate a robot until SIGINT or SIGTERM; it comes to rest before the end."""
    from hoap3.tools.analysis.summary import show_next_of_service, show_summary
    from hoap3.tools.services.configs import load_emulator_config
    from hoap3.tools.services.messages import ServiceConfig
    from hoap3.tools.services.services import run_emulator

    stop = StopFlag()
    sets = with_secure(sets, secure, insecure=insecure)
    settings, file = load_emulator_config(config, sets, realtime=not no_realtime)
    if as_json and settings.log.json_lines is not None:
        problem, remedy = "is on standard output, and so is --json", "Drop one of them"
        raise ConfigError(file, "log.json_lines", settings.log.json_lines, problem, remedy)
    service = ServiceConfig(settings, file, out, duration, verbose=verbose)
    code, summary = run_emulator(service, stop, lockstep=lockstep)
    if summary is not None and as_json:
        print_json(summary)
    elif summary is not None and settings.log.json_lines is None:
        show_summary(summary)
        show_next_of_service(summary["log"], side="robot")
    raise typer.Exit(code)


@app.command()
def controller(
    config: Annotated[str, typer.Argument(help="Controller config: a name or a path.")],
    duration: Duration = None,
    out: Out = None,
    no_realtime: NoRealtime = False,
    verbose: Verbose = False,
    sets: Sets = [],  # noqa: B006
    secure: Secure = None,
) -> None:
    """Control a robot until SIGINT or SIGTERM; wait for it while it is absent."""
    from hoap3.tools.services.configs import load_controller_config
    from hoap3.tools.services.messages import ServiceConfig
    from hoap3.tools.services.services import run_controller

    stop = StopFlag()
    sets = with_secure(sets, secure)
    given = load_controller_config(config, sets, realtime=not no_realtime)
    service = ServiceConfig(*given, out, duration, verbose=verbose)
    raise typer.Exit(run_controller(service, stop))


@app.command("list")
def list_all(
    live: Annotated[bool, typer.Option("--live", help="List running robots, too.")] = False,
    connect: Annotated[
        str | None,
        typer.Option(help=f"With --live: where to look besides this machine; default: {ENDPOINT}."),
    ] = None,
    secure: Secure = None,
    as_json: AsJson = False,
) -> None:
    """List the names of robots, controllers, tasks, curves, constraints and configs."""
    from hoap3.tools.services.find_robot import live_robots
    from hoap3.tools.services.settings import named

    found, silent = named(), ""
    sessions: list[dict[str, Any]] = []
    if live:
        sessions, silent = live_robots(reached(connect, secure))
        found["alive"] = list(dict.fromkeys(each["robot"] for each in sessions))
    lines = [f"{kind}: {', '.join(names) or 'none'}" for kind, names in found.items()]
    lines += [f"  {each['robot']}: {place_of(each)}" for each in sessions]
    print_result({**found, "sessions": sessions} if live else found, lines, as_json=as_json)
    if silent:
        print_note(f"robots of the network are not listed: {silent}")
    if silent and (connect is not None or secure is not None):
        raise typer.Exit(1)


def _add_request(verb: str, help_text: str) -> None:
    """Add a command that sends a request to a running robot."""

    def request(
        robot: Running = None,
        connect: Connect = None,
        secure: Secure = None,
        as_json: AsJson = False,
    ) -> None:
        show_answers(robot, verb, reached(connect, secure), as_json)

    app.command(verb, help=help_text)(request)


_add_request("stop", "Bring a running robot to rest; it stays there until `recover`.")
_add_request("recover", "Let a stopped robot follow its controller again.")
_add_request("status", "Show the mode of a running robot, and the controller that it follows.")


@app.command()
def release(
    robot: Running = None,
    connect: Connect = None,
    secure: Secure = None,
    as_json: AsJson = False,
) -> None:
    """Release the authority over a robot, whichever client holds it; the robot brakes.

    On this machine the user of the robot may do that, elsewhere the holder of an admin certificate.

    A controller that still runs gets authority again at once: end the controller first, or use
    `hoap3 stop` to keep the robot at rest.
    """
    from hoap3.tools.services.find_robot import release_robot

    name, answer = release_robot(robot, reached(connect, secure))
    words = "released" if answer["released"] else "follows nobody"
    print_result(answer, f"{name}: {words}", as_json=as_json)


@app.command()
def record(
    robot: Running = None,
    repair: Annotated[
        Path | None,
        typer.Option(
            "--repair", metavar="LOG", help="Repair a log, or all logs of a run, instead."
        ),
    ] = None,
    duration: Duration = None,
    connect: Connect = None,
    secure: Secure = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Record a running robot from outside, or repair a log that was cut off."""
    from hoap3.tools.services.find_robot import reach_robot
    from hoap3.tools.services.record import record_robot

    if repair is not None:
        _repair(repair, as_json)
        return
    name, endpoint = reach_robot(robot, reached(connect, secure))
    outcome = record_robot(name, endpoint, out, duration, to_people)
    words = f"{outcome['states']} states, {outcome['setpoints']} setpoints: {outcome['log']}"
    print_result(outcome, words, as_json=as_json)


@app.command()
def replay(
    log: LogPath,
    sets: Sets = [],  # noqa: B006
    tolerance: Annotated[
        float,
        typer.Option(
            min=0.0, callback=finite, help="Differences of values up to this are accepted."
        ),
    ] = 0.0,
    allow_code: Annotated[
        bool,
        typer.Option("--allow-code", help="Import a controller that is named as module:Class."),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Run the logged controller on its logged inputs and compare every setpoint."""
    watch_compilation()
    from hoap3.tools.analysis.replay import replay as again

    with progress(f"replay {log}") as meter:
        report = again(
            *(log, sets),
            tolerance=tolerance,
            allow_code=allow_code,
            say=meter.step,
            note=print_note,
        )
    print_result(report.as_json(), str(report), as_json=as_json)
    raise typer.Exit(0 if report.passed else 1)


@app.command()
def export(
    log: LogPath,
    to: Annotated[Path, typer.Option("--to", help="File to write: *.csv, *.parquet or *.npz.")],
    side: Annotated[
        str, typer.Option(help="Log of a run to export: robot or controller.")
    ] = "robot",
    as_json: AsJson = False,
) -> None:
    """Write a log as CSV, Parquet or numpy arrays; exit code 1 if a part of the log is lost."""
    from hoap3.tools.logs.export import export as write

    with progress(f"export {log}") as meter:
        written = write(log, to, side, meter.step)
    print_result(written.as_json(), str(written), as_json=as_json)
    for file in written.replaced:
        print_note(f"{file}: written in place of an earlier file")
    if written.missing:
        print_note(f"the log is not complete: {written.missing}")
    raise typer.Exit(0 if written.complete else 1)


@config_app.command("show")
def config_show(
    name: Annotated[str, typer.Argument(help="Config: a name or a path.")],
    sets: Sets = [],  # noqa: B006
    allow_code: AllowCode = False,
) -> None:
    """Print a config with all defaults as YAML."""
    from hoap3.protocol.config.user_code import user_code
    from hoap3.tools.services.settings import shown

    with user_code(allowed=allow_code, say=print_note) as code:
        print_line(shown(name, sets, code).rstrip("\n"))
    if code.names and not allow_code:
        print_note(
            f"parameters are as they are written: {', '.join(code.names)} is code, and is imported "
            "only with --allow-code"
        )


@config_app.command("check")
def config_check(
    names: Annotated[list[str], typer.Argument(help="Configs: names or paths.")],
    sets: Sets = [],  # noqa: B006
    robot: Annotated[
        str | None, typer.Option(help="Robot or emulator config to build controllers for.")
    ] = None,
    allow_code: AllowCode = False,
) -> None:
    """Check configs as a start does, those of controllers together with their robots."""
    watch_compilation()
    from hoap3.protocol.config.user_code import user_code
    from hoap3.tools.services.settings import checked

    for name in names:
        with user_code(allowed=allow_code, say=print_note):
            print_line(f"{name}: {checked(name, sets, robot)}")


@config_app.command("schema")
def config_schema(
    kind: Annotated[
        str, typer.Argument(help="emulator, controller, task, constraint, or a controller's name.")
    ],
    name: Annotated[
        str | None, typer.Argument(help="Name of a controller, task or constraint.")
    ] = None,
) -> None:
    """Print the JSON Schema of a config, task or constraint, for editors."""
    from hoap3.tools.services.settings import json_schema

    print_json(json_schema(kind, name))


@config_app.command("keys")
def config_keys(
    kind: Annotated[
        str,
        typer.Argument(
            help="emulator, controller, a controller's name, or task, constraint or curve."
        ),
    ],
    name: Annotated[
        str | None, typer.Argument(help="Name of a controller, task, constraint or curve.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Print all keys of a config, or of a part of it: type, unit, default and meaning."""
    from hoap3.tools.services.settings import config_keys as find

    found = find(kind, name)
    keys = {"keys": [key._asdict() for key in found]}
    print_result(keys, "\n".join(map(str, found)), as_json=as_json)


def _version(value: bool) -> None:
    if value:
        from hoap3.tools.machine.machine import versions

        for name, version in versions().items():
            print_line(f"{name} {version}")
        raise typer.Exit


@app.callback(cls=GroupedCommands)
def _root(
    context: typer.Context,
    _: Annotated[
        bool,
        typer.Option(
            "--version", callback=_version, is_eager=True, help="Print versions and exit."
        ),
    ] = False,
) -> None:
    """Control a robot from a separate process at 1 kHz; see why each deadline was met or missed."""
    command = context.invoked_subcommand or ""
    check_memory(NEEDED_MB.get(command))
    if command not in LIGHT:
        check_libraries()


def _repair(path: Path, as_json: bool) -> None:
    from hoap3.tools.logs.repair import repair, repair_all

    reports, wrong = repair_all(path) if path.is_dir() else ([repair(path)], [])
    found = [report.as_json() for report in reports]
    content = {"logs": found} if path.is_dir() else found[0]
    print_result(content, map(str, reports), as_json=as_json)
    if wrong:
        raise LogError("; ".join(wrong))
    if any(report.damaged or report.doubts for report in reports):
        raise typer.Exit(1)


@cache
def command_line() -> Any:
    """`hoap3` as click knows it; made once, as that takes some 65 ms."""
    return typer.main.get_command(app)


def _with_xacro_arguments(words: list[str]) -> list[str]:
    """Put `NAME:=VALUE` of a command line behind the robot's file, as one word with it.

    Raises:
        UsageError: no word is a robot's file.
    """
    arguments = [word for word in words if re.match(r"[A-Za-z_]\w*:=", word)]
    if not arguments:
        return words
    from hoap3.robot_emulator.robots.urdf_import.source import is_source

    rest = [word for word in words if word not in arguments]
    file = next((place for place, word in enumerate(rest) if is_source(word)), None)
    if file is None:
        remedy = "Name the xacro file here, or write `robot: FILE NAME:=VALUE` into a config"
        raise UsageError(f"{arguments[0]}: no xacro file is named that takes it. {remedy}")
    rest[file] = " ".join((rest[file], *arguments))
    return rest


def main() -> None:
    """Entry point of `hoap3`."""

    def program() -> None:
        check_command_line(sys.argv[1:])
        command_line()(_with_xacro_arguments(sys.argv[1:]))

    run_program(program)


if __name__ == "__main__":
    main()
