"""How the figures of a comparison are written, on the page and in a terminal."""

from __future__ import annotations

from typing import Any

from tools.compare.comparison import Comparison
from tools.compare.figures import WORDS, Figures, Word, value
from tools.compare.series import SPEED
from tools.report.numbers import number

OF_SPEED = {"u": SPEED, "u·s": "rad", "u²·s": "rad²/s"}


def shown_words(made: Comparison) -> list[Word]:
    """Figures that say something of one controller at least: known, or not 0 where 0 is usual."""
    return [word for word in WORDS if any(_shown(found, word.key) for found in made.figures)]


def unit(word: Word, made: Comparison) -> str:
    """Unit of a figure; that of u in words where it is a speed for all controllers."""
    speeds = all(found["unit"] == SPEED for found in made.figures)
    return OF_SPEED.get(word.unit, word.unit) if speeds else word.unit


def cell(found: Figures, key: str) -> str:
    """One figure as text."""
    given: Any = value(found, key)
    return "–" if given is None else number(given)


def _shown(found: Figures, key: str) -> bool:
    if key == "error.settled_s":  # not there yet is an answer, too
        key = "error.start"
    given = value(found, key)
    quiet = key.startswith("certificates.") and key != "certificates.certified"
    return given is not None and not (quiet and given == 0)
