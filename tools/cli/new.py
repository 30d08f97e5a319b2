"""The command `hoap3 new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hoap3.tools.cli.options import AsJson
from hoap3.tools.show.output import print_json, print_line


def new(
    kind: Annotated[
        str, typer.Argument(metavar="KIND", help="controller, task, constraint, robot or plant.")
    ],
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="What it is called in configs, and its module.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder to write; default: the name.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write a package to begin with: one that works, its config, its tests, its entry point."""
    from hoap3.tools.new.package import write_package

    written = write_package(kind, name, out)
    if as_json:
        print_json(
            {
                "kind": kind,
                "name": name,
                "folder": str(written.folder),
                "files": list(written.files),
                "next": list(written.next),
            }
        )
        return
    print_line(f"{kind} {name}: {len(written.files)} files in {written.folder}")
    print_line("next:")
    for command in written.next:
        print_line(f"  {command}")
