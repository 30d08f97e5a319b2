"""Commands that read a log: `report`, `verify`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hoap3.tools.analysis.output import print_json, print_line, print_note, print_result, progress
from hoap3.tools.cli.options import AllowCode, AsJson, LogPath

MOST_NAMED = 5  # false claims


def report(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG", help="Folder of a run, one *.mcap, or the folders of both services."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", help="HTML file to write; default: report.html next to the log."),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(help="Name or folder of the robot, to draw it with its meshes."),
    ] = None,
    verify: Annotated[
        bool, typer.Option("--verify/--no-verify", help="Recompute what the log claims.")
    ] = True,
    allow_code: AllowCode = False,
    as_json: AsJson = False,
) -> None:
    """Write a report about a log, as one self-contained HTML file."""
    from hoap3.tools.machine.machine import check_extra

    check_extra("report")
    from hoap3.tools.analysis.certificates import in_a_line
    from hoap3.tools.analysis.report.page import write_report
    from hoap3.tools.analysis.verdicts import NAMES, failed, in_words

    log = logs[0]
    options: dict[str, Any] = {"robot": robot, "allow_code": allow_code, "verify": verify}
    with progress(f"report {log}") as meter:
        figures = write_report(*logs, out=out, say=meter.step, **options)
    if as_json:
        print_json(figures)
    else:
        print_line(str(figures["report"]))
        for key, words in in_words(figures).items():
            print_line(f"{NAMES[key]}: {figures['verdicts'][key]}; {words}")
        unproved = in_a_line(figures["certificates"])
        if unproved is not None:
            print_line(f"certificates: {unproved}")
        verified = figures["verified"]
        if verified["verdict"] == "false":
            which = ", ".join(verified["false_claims"][:MOST_NAMED])
            counts = f"{verified['false']} of {verified['checked']}"
            print_line(f"claims: {counts} are not true: {which}")
        if figures["replaced"]:
            print_note("written in place of an earlier report")
    for part in figures["verified"]["unjudged"]:
        print_note(f"not verified: {part}")
    for side, why in figures["unreadable"].items():
        print_note(f"the log of the {side} cannot be read: {why}")
    for side, lost in figures["damaged"].items():
        print_note(
            f"the log of the {side} is cut off or damaged, and shown as far as it can be read: "
            f"{lost}"
        )
    if figures["repairable"]:
        print_note(
            f"`hoap3 record --repair {log}` makes a whole file of the rest, to be named by itself"
        )
    incomplete = figures["damaged"] or figures["unreadable"] or figures["verified"]["unjudged"]
    untrue = figures["verified"]["verdict"] == "false"
    raise typer.Exit(1 if incomplete or untrue or failed(figures["verdicts"]) else 0)


def verify(
    log: LogPath,
    every: Annotated[
        bool,
        typer.Option("--all", help="Recompute all certificates, not only a random sample."),
    ] = False,
    allow_code: AllowCode = False,
    allow_unverified: Annotated[
        bool,
        typer.Option("--allow-unverified", help="Exit code 0 if nothing is false."),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Recompute what a log claims; exit code 1 unless all of it was recomputed and holds."""
    from hoap3.tools.verify.show import shown
    from hoap3.tools.verify.verify import verify as verify_log

    with progress(f"verify {log}") as meter:
        found = verify_log(log, meter.step, repeat=True, allow_code=allow_code, every=every)
    print_result(found.as_json(), shown(found), as_json=as_json)
    if found.missing:
        print_note(f"the log is not complete: {found.missing}")
    passed = found.true or (allow_unverified and not found.claims.false)
    raise typer.Exit(0 if passed else 1)
