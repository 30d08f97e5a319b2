"""Makes the pictures of the pages again: `python docs/pictures/make.py [NAME …]`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import gains
import limits
import matplotlib as mpl
import moving
import objective
import packages
import ranks
import rates
from drawing import STYLE, save
from matplotlib.figure import Figure

FOLDER = Path(__file__).parent
DRAWN = (
    *(objective.gamma, rates.rho, limits.distance),
    *(moving.circulation, ranks.priorities, gains.gains, packages.packages),
)
PICTURES: dict[str, Callable[[], Figure]] = {draw.__name__: draw for draw in DRAWN}
"""Every picture, by the name of its file."""


def make(name: str, folder: Path) -> Path:
    """Make one picture."""
    with mpl.rc_context(STYLE):
        return save(name, PICTURES[name](), folder)


def main() -> int:
    """Make those that are named, or all."""
    wanted = sys.argv[1:] or [*PICTURES]
    unknown = [name for name in wanted if name not in PICTURES]
    if unknown:
        sys.stderr.write(f"no picture {', '.join(unknown)}; there are {', '.join(PICTURES)}\n")
        return 2
    for name in wanted:
        sys.stderr.write(f"{make(name, FOLDER)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
