"""What several commands ask of their options."""

from __future__ import annotations

import math
from typing import Annotated

import typer

ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a robot listens by default."""


def finite(value: float | None) -> float | None:
    """Refuse nan and inf, which pass the comparison with a minimum."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter("is not a finite number")
    return value


AsJson = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")]
Connect = Annotated[
    str | None,
    typer.Option(
        "--connect",
        help=f"Endpoint of a robot or a router. Default: this machine, else {ENDPOINT}.",
    ),
]
