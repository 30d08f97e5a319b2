"""The command line. It only wires: what a command does stands in a module of its own.

Results go to standard output, with `--json` as one JSON object; notes, progress and errors go to
standard error. Exit codes: 0 no verdict fails, 1 findings, 2 wrong usage or settings.
"""

from __future__ import annotations

import io
import json
import os
import re
import sys
import warnings
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TextIO

import typer

from hoap3.protocol.errors import (
    ConfigError,
    Hoap3Error,
    LimitWarning,
    LogError,
    UrdfWarning,
    UsageError,
)
from hoap3.remote_controller.pairs import DEFAULT_CONFIG
from hoap3.tools.cli.answers import place_of, show_answers
from hoap3.tools.cli.change import change, priorities
from hoap3.tools.cli.compare import compare
from hoap3.tools.cli.latency import latency
from hoap3.tools.cli.limits import limits
from hoap3.tools.cli.measure import bench_app, doctor
from hoap3.tools.cli.new import new
from hoap3.tools.cli.options import (
    ENDPOINT,
    AllowCode,
    AsJson,
    Connect,
    LockJoints,
    NoRealtime,
    RunController,
    RunRobot,
    Secure,
    Sets,
    Tip,
    Verbose,
    finite,
    reached,
    with_secure,
)
from hoap3.tools.cli.report import report
from hoap3.tools.cli.reproduce import reproduce
from hoap3.tools.cli.robot import robot_app
from hoap3.tools.cli.secure.certs import certs_app
from hoap3.tools.cli.services.service import service_app
from hoap3.tools.cli.services.soak import soak
from hoap3.tools.cli.trajectory import trajectory_app
from hoap3.tools.cli.verify import verify
from hoap3.tools.cli.viewers.bridge import bridge_app
from hoap3.tools.cli.viewers.help import NEEDED_MB, GroupedCommands, show_help
from hoap3.tools.cli.viewers.view import view
from hoap3.tools.machine.processes import StopFlag, check_memory, die_with_parent, to_people
from hoap3.tools.show.kernel_news import watch_compilation
from hoap3.tools.show.output import print_json, print_line, print_note, progress

_show_by_python = warnings.showwarning
_notes: set[str] = set()
app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)
config_app = typer.Typer(no_args_is_help=True, help="Look at settings before anything runs.")
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
_ANYTHING = {"ignore_unknown_options": True, "allow_extra_args": True}
app.command("help")(show_help)
app.command(hidden=True, context_settings=_ANYTHING)(priorities)


Duration = Annotated[
    float | None,
    typer.Option(min=0.001, callback=finite, help="Of motion or record [s]; default: no end."),
]
Out = Annotated[
    Path | None, typer.Option("--out", help="Folder for the log; default: a new one in logs/.")
]
StatusFd = Annotated[int | None, typer.Option("--status-fd", hidden=True)]
Named = Annotated[str | None, typer.Option("--named", hidden=True)]
Running = Annotated[
    str | None, typer.Argument(help="Name of the robot. Default: the only one that runs.")
]


@app.command()
def run(
    robot: RunRobot = None,
    controller: RunController = DEFAULT_CONFIG,
    duration: Annotated[
        float, typer.Option(min=0.001, callback=finite, help="Of the motion [s].")
    ] = 5.0,
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="Virtual time, in one process.")
    ] = False,
    seed: Annotated[int | None, typer.Option(min=0, help="Of everything random.")] = None,
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
    from hoap3.tools.services.run import run_lockstep, run_realtime
    from hoap3.tools.services.services import controller_config, emulator_config, split_overrides
    from hoap3.tools.show.summary import LiveTable, show_next, show_summary
    from hoap3.tools.show.verdicts import failed

    stop = StopFlag()
    ours, theirs = split_overrides(sets)
    if seed is not None:
        ours.append(f"seed={seed}")
    law, law_file = controller_config(controller, theirs, realtime=not no_realtime)
    parts = {"tip": tip, "lock_joints": lock_joints}
    ours += [f"{key}={json.dumps(each, ensure_ascii=False)}" for key, each in parts.items() if each]
    emulator, emulator_file = emulator_config(robot or law.robot, ours, realtime=not no_realtime)
    files = (emulator_file, law_file)
    title = f"{Path(emulator.robot).name} with {controller}, {duration:g} s"
    if lockstep:
        with progress(f"{title} in lockstep") as meter:
            summary = run_lockstep(
                emulator, law, duration, out, files, should_stop=stop, report=meter.part
            )
    else:
        with LiveTable(title, verbose=verbose) as table:
            summary = run_realtime(
                emulator, law, duration, out, table.news, files, should_stop=stop
            )
    if as_json:
        print_json(summary)
    else:
        show_summary(summary)
        show_next(summary)
    bad = failed(summary["verdicts"]) or summary["log_lost"] or summary["metrics_lost"]
    raise typer.Exit(1 if bad else 0)


@app.command()
def emulator(
    config: Annotated[str, typer.Argument(help="Emulator config or robot: a name or a path.")],
    lockstep: Annotated[bool, typer.Option("--lockstep", help="Virtual time over Zenoh.")] = False,
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
    status_fd: StatusFd = None,
    named: Named = None,
) -> None:
    """Be a robot, until SIGINT or SIGTERM; it comes to rest first."""
    from hoap3.tools.services.services import emulator_config, run_emulator
    from hoap3.tools.show.summary import show_summary

    stop = StopFlag()
    sets = with_secure(sets, secure, insecure=insecure)
    settings, file = emulator_config(config, sets, realtime=not no_realtime, named=named)
    if as_json and settings.log.tells_json:
        problem, remedy = "is on standard output, and so is --json", "Name a file, or drop --json"
        raise ConfigError(file, "log.json_lines", settings.log.json_lines, problem, remedy)
    code, summary = run_emulator(
        settings,
        file,
        lockstep=lockstep,
        duration=duration,
        out=out,
        status_fd=status_fd,
        should_stop=stop,
        verbose=verbose,
    )
    if summary is not None and as_json:
        print_json(summary)
    elif summary is not None and status_fd is None and not settings.log.tells_json:
        show_summary(summary)
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
    status_fd: StatusFd = None,
    named: Named = None,
) -> None:
    """Control a robot, until SIGINT or SIGTERM; waits for it, and survives its absence."""
    from hoap3.tools.services.services import controller_config, run_controller

    stop = StopFlag()
    sets = with_secure(sets, secure)
    given = controller_config(config, sets, realtime=not no_realtime, named=named)
    code = run_controller(
        *given, out=out, status_fd=status_fd, should_stop=stop, verbose=verbose, duration=duration
    )
    raise typer.Exit(code)


@app.command("list")
def list_all(
    live: Annotated[bool, typer.Option("--live", help="Also the robots that are alive.")] = False,
    connect: Annotated[
        str | None,
        typer.Option(help=f"Endpoint to look at with --live, beside this machine; {ENDPOINT}."),
    ] = None,
    secure: Secure = None,
    as_json: AsJson = False,
) -> None:
    """List robots, controllers, tasks, curves, constraints and configs that can be named."""
    from hoap3.tools.services.find_robot import live_robots
    from hoap3.tools.services.settings import named

    found, silent = named(), ""
    sessions: list[dict[str, Any]] = []
    if live:
        sessions, silent = live_robots(reached(connect, secure))
        found["alive"] = list(dict.fromkeys(each["robot"] for each in sessions))
    if live and as_json:
        print_json({**found, "sessions": sessions})
    elif as_json:
        print_json(found)
    else:
        for kind, names in found.items():
            print_line(f"{kind}: {', '.join(names) or 'none'}")
        for each in sessions:
            print_line(f"  {each['robot']}: {place_of(each)}")
    if silent:
        print_note(f"robots of the network are not listed: {silent}")
    if silent and (connect is not None or secure is not None):
        raise typer.Exit(1)


@app.command()
def stop(
    robot: Running = None,
    connect: Connect = None,
    secure: Secure = None,
    as_json: AsJson = False,
) -> None:
    """Bring a running robot to rest; it stays there until `recover`."""
    show_answers(robot, "stop", reached(connect, secure), as_json)


@app.command()
def recover(
    robot: Running = None,
    connect: Connect = None,
    secure: Secure = None,
    as_json: AsJson = False,
) -> None:
    """Let a stopped robot follow its controller again."""
    show_answers(robot, "recover", reached(connect, secure), as_json)


@app.command()
def status(
    robot: Running = None,
    connect: Connect = None,
    secure: Secure = None,
    as_json: AsJson = False,
) -> None:
    """Say what a running robot does, and whom it follows."""
    show_answers(robot, "status", reached(connect, secure), as_json)


@app.command()
def release(
    robot: Running = None,
    connect: Connect = None,
    secure: Secure = None,
    as_json: AsJson = False,
) -> None:
    """Take authority from whoever holds it over a robot; the robot brakes.

    On this machine its user may, and elsewhere who has the certificate of an admin.

    A controller that still runs asks for authority again at once, and the robot follows it: end the
    controller first, or use `hoap3 stop`, where the robot is to stay at rest.
    """
    from hoap3.tools.services.find_robot import release_robot

    name, answer = release_robot(robot, reached(connect, secure))
    if as_json:
        print_json(answer)
    else:
        print_line(f"{name}: " + ("released" if answer["released"] else "follows nobody"))


@app.command()
def record(
    robot: Running = None,
    repair: Annotated[
        Path | None,
        typer.Option("--repair", metavar="LOG", help="Repair a log, or all of a run, instead."),
    ] = None,
    duration: Duration = None,
    connect: Connect = None,
    secure: Secure = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Record a running robot from outside, or mend a log that was cut off."""
    from hoap3.tools.services.find_robot import reach_robot
    from hoap3.tools.services.record import record_robot

    if repair is not None:
        _repair(repair, as_json)
        return
    name, endpoint = reach_robot(robot, reached(connect, secure))
    outcome = record_robot(name, endpoint, out, duration, to_people)
    if as_json:
        print_json(outcome)
    else:
        print_line(
            f"{outcome['states']} states, {outcome['setpoints']} setpoints: {outcome['log']}"
        )


@app.command()
def replay(
    log: Annotated[Path, typer.Argument(help="Log of a controller, or the folder of a run.")],
    sets: Sets = [],  # noqa: B006
    tolerance: Annotated[
        float, typer.Option(min=0.0, callback=finite, help="Largest difference of a value.")
    ] = 0.0,
    allow_code: Annotated[
        bool, typer.Option("--allow-code", help="Run a controller that is not registered.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Run the logged controller on its logged inputs and compare every setpoint."""
    watch_compilation()
    from hoap3.tools.replay import replay as again

    with progress(f"replay {log}") as meter:
        report = again(
            *(log, sets),
            tolerance=tolerance,
            allow_code=allow_code,
            say=meter.step,
            note=print_note,
        )
    if as_json:
        print_json(report.as_json())
    else:
        print_line(str(report))
    raise typer.Exit(0 if report.passed else 1)


@app.command()
def export(
    log: Annotated[Path, typer.Argument(help="A log, or the folder of a run.")],
    to: Annotated[Path, typer.Option("--to", help="File to write: *.csv, *.parquet or *.npz.")],
    side: Annotated[str, typer.Option(help="robot or controller: whose log of a run.")] = "robot",
    as_json: AsJson = False,
) -> None:
    """Write a log as CSV, Parquet or numpy arrays; exit code 1 if a part of the log is lost."""
    from hoap3.tools.logs.export import export as write

    with progress(f"export {log}") as meter:
        written = write(log, to, side, meter.step)
    if as_json:
        print_json(written.as_json())
    else:
        print_line(str(written))
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
    """Print the whole of a config, defaults included, as YAML."""
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
        str | None, typer.Option(help="Robot or emulator config that controllers are built for.")
    ] = None,
    allow_code: AllowCode = False,
) -> None:
    """Check configs, those of controllers also against their robots, as a start does."""
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
        str | None, typer.Argument(help="Of a controller, a task or a constraint.")
    ] = None,
) -> None:
    """Print the JSON Schema of a config, or of a task or a constraint in one, for editors."""
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
        str | None, typer.Argument(help="Of a controller, a task, a constraint or a curve.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Print every key of a config, or of what one names: type, unit, default, meaning."""
    from hoap3.tools.services.config_keys import config_keys as find

    found = find(kind, name)
    if as_json:
        print_json({"keys": [key._asdict() for key in found]})
    else:
        print_line("\n".join(map(str, found)))


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
        typer.Option("--version", callback=_version, is_eager=True, help="Versions of the stack."),
    ] = False,
) -> None:
    """Control a robot from a separate process at 1 kHz; see why each deadline was met or missed."""
    check_memory(NEEDED_MB.get(context.invoked_subcommand or ""))


def _repair(path: Path, as_json: bool) -> None:
    from hoap3.tools.logs.repair import repair, repair_all

    reports, wrong = repair_all(path) if path.is_dir() else ([repair(path)], [])
    if as_json and path.is_dir():
        print_json({"logs": [report.as_json() for report in reports]})
    elif as_json:
        print_json(reports[0].as_json())
    else:
        for report in reports:
            print_line(str(report))
    if wrong:
        raise LogError("; ".join(wrong))
    if any(report.damaged or report.doubts for report in reports):
        raise typer.Exit(1)


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Print a warning about a robot or a config in one line, and others as Python does."""
    if issubclass(category, UrdfWarning):
        if str(message) not in _notes:  # a robot may be read more than once
            _notes.add(str(message))
            to_people(f"note: {message}")
    elif issubclass(category, LimitWarning):
        to_people(f"warning: {message}")
    else:
        _show_by_python(message, category, filename, lineno, file, line)


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
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # read once, when numpy is imported
    warnings.showwarning = _show_warning
    try:
        for stream in (sys.stdout, sys.stderr):  # a terminal that knows ASCII only shows `?`
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="replace")
        die_with_parent()
        command_line()(_with_xacro_arguments(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(1)
    except Hoap3Error as error:
        to_people(f"error: {error}")
        sys.exit(2 if isinstance(error, UsageError) else 1)
    except OSError as error:
        named = f" (found {error.filename!r:.80})" if error.filename else ""
        to_people(f"error: {error.strerror or error}{named}. Name another file or folder")
        sys.exit(1)


if __name__ == "__main__":
    main()
