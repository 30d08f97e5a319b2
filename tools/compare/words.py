"""How the figures of a comparison are written, on the page and in a terminal."""

from __future__ import annotations

from typing import Any

from hoap3.tools.compare.comparison import Comparison
from hoap3.tools.compare.figures import WORDS, Figures, Word, value
from hoap3.tools.html.numbers import number
from hoap3.tools.report.motion import UNITS
from hoap3.tools.show.final_error import units_of_v

OF_U = dict(
    zip(
        UNITS.values(),
        (
            {"u": "rad/s", "u·s": "rad", "u²·s": "rad²/s"},
            {"u": "rad/s²", "u·s": "rad/s", "u²·s": "rad²/s³"},
            {"u": "N m", "u·s": "N m s", "u²·s": "(N m)² s"},
        ),
        strict=True,
    )
)
"""Units of figures, by that of u."""


def shown_words(made: Comparison) -> list[Word]:
    """Figures that say something of one controller at least: known, or not 0 where 0 is usual."""
    return [word for word in WORDS if any(_shown(found, word.key) for found in made.figures)]


OF_TASK = "unit of the task"


def unit(what: str, made: Comparison) -> str:
    """Unit of a figure, which has u or the task in it where controllers differ in what it is."""
    if what.startswith(OF_TASK):
        told = {" and ".join(units_of_v(found)) for found in made.figures}
        name = told.pop()
        return what if told or not name or " and " in name else what.replace(OF_TASK, name)
    units = {found["unit"] for found in made.figures}
    known = OF_U.get(units.pop(), {}) if len(units) == 1 else {}
    return known.get(what, what)


def cell(found: Figures, key: str) -> str:
    """One figure as text."""
    given: Any = value(found, key)
    return given if isinstance(given, str) else "–" if given is None else number(given)


def _shown(found: Figures, key: str) -> bool:
    if key == "error.settled_s":  # not there yet is an answer, too
        key = "error.start"
    given = value(found, key)
    quiet = key.startswith("certificates.") and key != "certificates.certified"
    return given is not None and not (quiet and given == 0)
