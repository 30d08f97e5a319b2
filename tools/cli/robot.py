"""The commands `hoap3 robot`: vendors' URDFs become robots, and robots are looked at."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hoap3.tools.cli.options import AsJson, LockJoints, Tip
from hoap3.tools.show.output import print_json, print_line, print_note

robot_app = typer.Typer(no_args_is_help=True, help="Make a robot of a vendor's URDF; look at one.")

PackagePath = Annotated[
    list[Path],
    typer.Option(
        "--package-path",
        metavar="DIR",
        help="Folder that is a package, or holds some: for package://. Before HOAP3_PACKAGE_PATH.",
    ),
]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict", help="A mesh that is missing, cannot be read or is another one is an error."
    ),
]


@robot_app.command("import")
def import_(
    file: Annotated[
        str,
        typer.Argument(metavar="FILE", help="URDF, xacro NAME:=VALUE, robot_descriptions:NAME"),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder to write; default: the robot's name.")
    ] = None,
    name: Annotated[
        str | None, typer.Option("--name", help="Of the robot; default: as the URDF has it.")
    ] = None,
    package_path: PackagePath = [],  # noqa: B006 - typer's own way
    strict: Strict = False,
    tip: Tip = None,
    lock_joints: LockJoints = [],  # noqa: B006
    as_json: AsJson = False,
) -> None:
    """Write the folder of a robot: robot.yaml, the URDF that travels, meshes for drawing."""
    from hoap3.robot_emulator.robots.urdf_import.folder import write_folder
    from hoap3.robot_emulator.robots.urdf_import.imported import import_robot

    robot = import_robot(
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
    for note in robot.notes:
        print_note(str(note))
    print_line(f"{robot.file.name}: {robot.description.n} joints, {len(written)} files in {folder}")
    path = folder if folder.is_absolute() else f"./{folder}"  # a bare name would come first
    print_note(f"next:  hoap3 robot check {path}")
    print_note(f"       hoap3 run --robot {path}")


@robot_app.command("check")
def check(
    path: Annotated[str, typer.Argument(help="URDF, folder, YAML file, or the name of a robot.")],
    package_path: PackagePath = [],  # noqa: B006
    strict: Strict = False,
    tip: Tip = None,
    lock_joints: LockJoints = [],  # noqa: B006
    as_json: AsJson = False,
) -> None:
    """Say what a robot is: joints, limits, what is guessed, what follows, masses, shapes, tip."""
    from hoap3.tools.robots.robot_facts import as_json as facts_as_json
    from hoap3.tools.robots.robot_facts import look, show

    found = facts_as_json(look(path, package_path, strict=strict, tip=tip, lock_joints=lock_joints))
    if as_json:
        print_json(found)
    else:
        show(found)
