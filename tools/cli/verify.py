"""The commands `hoap3 verify` and `hoap3 prove`: what a log claims, and what the code does."""

from __future__ import annotations

from enum import StrEnum
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


class Subject(StrEnum):
    """What can be proved."""

    AUTHORITY = "authority"
    FILTER = "filter"
    JERK = "jerk"


def prove(
    subject: Annotated[Subject, typer.Argument(help="Part of the robot that is proved.")],
    clients: Annotated[int, typer.Option(min=1, max=4, help="authority: that ask.")] = 3,
    requests: Annotated[int, typer.Option(min=0, help="authority: that the robot serves.")] = 6,
    crashes: Annotated[int, typer.Option(min=0, help="authority: of clients or the robot.")] = 2,
    bits: Annotated[int, typer.Option(min=8, max=11, help="filter: of the exhaustive run.")] = 8,
    states: Annotated[
        int, typer.Option(min=1, help="filter: compared with strict arithmetic.")
    ] = 1_000_000,
    faults: Annotated[bool, typer.Option(help="Plant faults, which must be found.")] = True,
    as_json: AsJson = False,
) -> None:
    """Prove what the robot's own code does; exit code 1 unless all holds, and faults are found."""
    from hoap3.tools.machine.extras import check_prover
    from hoap3.tools.prove.authority.proof import prove_authority
    from hoap3.tools.prove.filters.proof import prove_filter, prove_jerk

    def tell(what: str) -> None:
        print_note(f"{subject}: {what}")

    if subject is Subject.AUTHORITY:
        proof = prove_authority(clients, requests, crashes, faults=faults, tell=tell)
    elif subject is Subject.FILTER:
        check_prover()
        proof = prove_filter(bits, states, faults=faults, tell=tell)
    else:
        check_prover()
        proof = prove_jerk(faults=faults, tell=tell)
    if as_json:
        print_json(proof.as_json())
    else:
        for line in proof.lines():
            print_line(line)
    raise typer.Exit(0 if proof.holds else 1)
