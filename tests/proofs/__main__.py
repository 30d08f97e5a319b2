"""Command line of the proofs."""

from __future__ import annotations

import sys
from enum import StrEnum
from importlib.util import find_spec
from typing import Annotated

import typer

from hoap3.protocol.errors import Hoap3Error
from hoap3.tools.analysis.output import print_json, print_line, print_note
from hoap3.tools.cli.options import AsJson
from hoap3.tools.machine.processes import to_people

from .authority.proof import prove_authority
from .filters.proof import prove_filter, prove_jerk


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

    def tell(what: str) -> None:
        print_note(f"{subject}: {what}")

    if subject is not Subject.AUTHORITY and find_spec("z3") is None:
        raise Hoap3Error("z3 is not installed; run pip install -e '.[test]'")
    if subject is Subject.AUTHORITY:
        proof = prove_authority(clients, requests, crashes, faults=faults, tell=tell)
    elif subject is Subject.FILTER:
        proof = prove_filter(bits, states, faults=faults, tell=tell)
    else:
        proof = prove_jerk(faults=faults, tell=tell)
    if as_json:
        print_json(proof.as_json())
    else:
        for line in proof.lines():
            print_line(line)
    raise typer.Exit(0 if proof.holds else 1)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
app.command()(prove)

if __name__ == "__main__":
    try:
        app()
    except Hoap3Error as error:
        to_people(f"error: {error}")
        sys.exit(1)
