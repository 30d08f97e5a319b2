"""The command that re-makes papers: `hoap3 reproduce`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hoap3.tools.cli.options import AsJson
from hoap3.tools.show.kernel_news import watch_compilation
from hoap3.tools.show.output import print_json, progress


def reproduce(
    paper: Annotated[str, typer.Argument(help="Its name: bounds, ghc, qp12 or sdp.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", help="Folder for the files; default: a new one in reproduced/PAPER/."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Re-make a paper's figures and tables, and compare them with what its equations give."""
    from hoap3.tools.machine.extras import check_drawing

    check_drawing()
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
