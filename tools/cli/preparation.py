"""Commands that prepare robots, motions and code: `robot`, `trajectory`, `new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from hoap3.protocol.errors import ConfigError
from hoap3.tools.analysis.output import print_json, print_line, print_note, print_result
from hoap3.tools.cli.options import AsJson, LockJoints, LogPath, RobotConfig, Tip, finite

robot_app = typer.Typer(no_args_is_help=True, help="Import a robot from a URDF, or describe one.")

PackagePath = Annotated[
    list[Path],
    typer.Option(
        "--package-path",
        metavar="DIR",
        help="Folder of a package, or of several, for package://; before HOAP3_PACKAGE_PATH.",
    ),
]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict", help="Refuse meshes that are missing, unreadable or not the imported ones."
    ),
]


@robot_app.command("import")
def import_robot(
    file: Annotated[
        str,
        typer.Argument(metavar="FILE", help="URDF, xacro NAME:=VALUE, robot_descriptions:NAME"),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder to write; default: the robot's name.")
    ] = None,
    name: Annotated[
        str | None, typer.Option("--name", help="Name of the robot; default: that in the URDF.")
    ] = None,
    package_path: PackagePath = [],  # noqa: B006 - typer's own way
    strict: Strict = False,
    tip: Tip = None,
    lock_joints: LockJoints = [],  # noqa: B006
    as_json: AsJson = False,
) -> None:
    """Import a URDF: write a robot folder with robot.yaml, URDF and meshes."""
    from hoap3.robot_emulator.robots.urdf_import.folder import write_folder
    from hoap3.robot_emulator.robots.urdf_import.imported import import_robot as import_file

    robot = import_file(
        file, package_path, called=name, strict=strict, tip=tip, lock_joints=lock_joints
    )
    folder = out or Path(robot.file.name)
    written = write_folder(robot, folder)
    notes = [note.line() for note in robot.notes]
    if as_json:
        print_json(
            {
                "name": robot.file.name,
                "folder": str(folder),
                "files": [str(path.relative_to(folder)) for path in written],
                "notes": notes,
            }
        )
        return
    for note in notes:
        print_note(note)
    print_line(f"{robot.file.name}: {robot.description.n} joints, {len(written)} files in {folder}")
    path = folder if folder.is_absolute() else f"./{folder}"  # a bare name would come first
    print_note(f"next:  hoap3 robot check {path}")
    print_note(f"       hoap3 run --robot {path}")


@robot_app.command("check")
def check_robot(
    path: Annotated[str, typer.Argument(help="URDF, folder, YAML file, or the name of a robot.")],
    package_path: PackagePath = [],  # noqa: B006
    strict: Strict = False,
    tip: Tip = None,
    lock_joints: LockJoints = [],  # noqa: B006
    as_json: AsJson = False,
) -> None:
    """Describe a robot: joints, limits, guesses, mimic joints, masses, shapes and tip."""
    from hoap3.tools.robots.robot_facts import as_json as facts_as_json
    from hoap3.tools.robots.robot_facts import look, show

    found = facts_as_json(look(path, package_path, strict=strict, tip=tip, lock_joints=lock_joints))
    if as_json:
        print_json(found)
    else:
        show(found)


trajectory_app = typer.Typer(
    no_args_is_help=True, help="Check a motion before it runs, or take one from a log."
)


@trajectory_app.command("check")
def check_trajectory(
    file: Annotated[str, typer.Argument(metavar="FILE", help="CSV, log, or folder of a run.")],
    robot: RobotConfig,
    interpolation: Annotated[
        Literal["linear", "cubic", "quintic"] | None,
        typer.Option(help="Between points; default: by the columns of the file."),
    ] = None,
    time_scaling: Annotated[
        float, typer.Option(min=1e-6, callback=finite, help="Factor for all times.")
    ] = 1.0,
    approach: Annotated[
        float,
        typer.Option(
            min=0.0, callback=finite, help="Time to reach a first point whose time is 0 [s]."
        ),
    ] = 1.0,
    as_json: AsJson = False,
) -> None:
    """Show where a motion exceeds joint limits, and the slower motion that would fit."""
    from hoap3.tools.robots.trajectory_check import look, shown

    found = look(file, robot, interpolation, time_scaling, approach)
    print_result(found, shown(found), as_json=as_json)
    raise typer.Exit(1 if found["exceeded"] else 0)


@trajectory_app.command("from")
def trajectory_from(
    log: LogPath,
    out: Annotated[Path, typer.Option("--out", help="CSV file to write.")],
    played: Annotated[
        Literal["measured", "applied"],
        typer.Option(help="Measured, or commanded (applied) joint positions."),
    ] = "measured",
    every: Annotated[
        float, typer.Option(min=1e-6, callback=finite, help="Time between the points [s].")
    ] = 0.01,
) -> None:
    """Write the motion of a log as the CSV of a trajectory."""
    from hoap3.tools.logs.files import whole_file
    from hoap3.tools.logs.motion_files import motion_of

    text = motion_of(log, played, every)
    try:
        with whole_file(out) as draft:
            draft.write_text(text, encoding="utf-8")
    except OSError as error:
        remedy = "Name a file in a folder that can be written"
        reason = error.strerror or "cannot be written"
        raise ConfigError("--out", "", str(out), reason, remedy) from error
    print_line(f"{out}: {text.count(chr(10)) - 1} points")


def new(
    kind: Annotated[
        str, typer.Argument(metavar="KIND", help="controller, task, constraint, robot or plant.")
    ],
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Name in configs, and of its module.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder to write; default: the name.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write a working package to start from, with config, tests and entry point."""
    from hoap3.tools.new.package import write_package

    written = write_package(kind, name, out)
    found = {
        "kind": kind,
        "name": name,
        "folder": str(written.folder),
        "files": list(written.files),
        "next": list(written.next),
    }
    first = f"{kind} {name}: {len(written.files)} files in {written.folder}"
    lines = [first, "next:", *(f"  {command}" for command in written.next)]
    print_result(found, lines, as_json=as_json)
