"""Which controller for my robot? Several of them on the same task, beside each other.

    python examples/comparing_controllers.py
    python examples/comparing_controllers.py --robot hoap3 qp12@gamma=0 qp12@gamma=0.9 pinv

Each moves a robot of its own in lockstep, from the same start. What they did is compared as
`hoap3 compare` compares it, which writes a page with plots besides; docs/guides/measuring.md
defines each
figure.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import hoap3
from hoap3.tools.analysis.compare.comparison import Comparison, compare
from hoap3.tools.analysis.compare.figures import cell

CONTROLLERS = ["qp12", "gentle=qp12@gamma=0.9", "pinv", "stable_qp"]
COLUMNS = {
    "error, begin": "error.start",
    "end": "error.end",
    "to 1 % [s]": "error.settled_s",
    "∫ |u|₁": "control_effort.l1",
    "max |u|": "control_effort.max",
    "beyond position": "violations.position",
    "beyond speed": "violations.speed",
    "task": "verdicts.task",
    "limits and balance": "verdicts.limits_and_balance",
}
"""What is printed, error, effort, limits and verdicts, by its key in docs/guides/measuring.md."""


def measured(controllers: Sequence[str], robot: str, duration_s: float) -> Comparison:
    """Run them, in lockstep, with the same seed.

    Args:
        controllers: `[LABEL=]CONTROLLER[@KEY=VALUE,…]` each; the first one is the standard.
        robot: a name, or a path.
        duration_s: of each motion.
    """
    return compare(controllers, robot, duration_s, 0, timing=False)


def rows(made: Comparison) -> list[list[str]]:
    """A row of words for each controller, below one of headings."""
    return [
        ["controller", *COLUMNS],
        *(
            [label, *(cell(figures, key) for key in COLUMNS.values())]
            for label, figures in zip(made.labels, made.figures, strict=True)
        ),
    ]


def best(made: Comparison) -> dict[str, Any]:
    """Of those whose verdicts are pass, the figures of the one with the least effort."""
    good = [
        {"label": label, **figures}
        for label, figures in zip(made.labels, made.figures, strict=True)
        if {figures["verdicts"][name] for name in ("task", "limits_and_balance")} == {"pass"}
    ]
    return min(good, key=lambda figures: float(figures["control_effort"]["l1"]), default={})


def main() -> None:
    """Compare, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("controllers", nargs="*", default=CONTROLLERS)
    parser.add_argument("--robot", default="ur5")
    parser.add_argument("--duration", type=float, default=5.0)
    given = parser.parse_args()
    try:
        made = measured(given.controllers, given.robot, given.duration)
    except hoap3.Hoap3Error as error:
        raise SystemExit(f"comparing_controllers: {error}") from None
    table = rows(made)
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for row in table:
        print("  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)))
    for finding in made.findings:
        print("!", finding)
    print("least effort of those that pass:", best(made).get("label", "none"))


if __name__ == "__main__":
    main()
