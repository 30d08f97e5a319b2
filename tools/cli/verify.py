"""The command `hoap3 verify`: recompute what a log claims."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hoap3.tools.cli.options import AllowCode, AsJson
from hoap3.tools.show.output import print_json, print_line, print_note, progress


def verify(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Folder of a run, or one *.mcap.")],
    allow_code: AllowCode = False,
    as_json: AsJson = False,
) -> None:
    """Recompute what a log claims; exit code 1 unless all of it was recomputed, and holds."""
    from hoap3.tools.verify.show import shown
    from hoap3.tools.verify.verify import verify as judge

    with progress(f"verify {log}") as meter:
        found = judge(log, meter.step, repeat=True, allow_code=allow_code)
    if as_json:
        print_json(found.as_json())
    else:
        for line in shown(found):
            print_line(line)
    if found.missing:
        print_note(f"the log is not complete: {found.missing}")
    raise typer.Exit(0 if found.true else 1)
