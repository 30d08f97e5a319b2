"""Rows of a reproduction: what a paper states, what we find, and what that shows."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

TOLERANCE = 0.02
"""Relative, where nothing else is given."""

PRINTED = 0.1
"""Share of a printed number within which ours reproduces it."""

REPRODUCED = "printed number reproduced"
NOT_REPRODUCED = "printed number not reproduced"
CONFIRMED = "claim or equation confirmed"
MEASURED = "measured only"
CLASSES = (REPRODUCED, NOT_REPRODUCED, CONFIRMED, MEASURED)

TRIVIAL = {0.0, 1.0, math.inf}
"""Sizes that a paper states rather than reports: a row with one of them is a claim."""

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?"

Bounds = tuple[float | None, float | None]
Expected = Bounds | tuple[float, float, float] | None
"""Least and greatest value that pass, and an oracle's value where there is one; None: measured or
compared with the printed number only."""


@dataclass(frozen=True)
class Row:
    """A result of a paper next to ours.

    Attributes:
        item: what it is, and in which figure or table.
        paper: as printed: a number, also as text with its digits ("1.0e-6", "1 to 2"), words, or
            None where the paper gives nothing.
        ours: found in this run.
        unit: of both.
        reference: value of an oracle: a number, or None where there are only bounds.
        tolerance: least and greatest value of `ours` that pass, None for no bound; None where only
            the printed number is compared, or nothing.
        why: what was compared or counted.
        differs: why ours is not the printed number.
        fitted: what was chosen such that this number comes out, "" for nothing.
        timed: whether it is a time of this machine, which no other machine's compares with.
    """

    item: str
    paper: float | str | None
    ours: float
    why: str
    unit: str = ""
    reference: float | None = None
    tolerance: Bounds | None = None
    differs: str = ""
    fitted: str = ""
    timed: bool = False

    @property
    def printed(self) -> tuple[float, float] | None:
        """Range of values that reproduce the printed number, or None where none is printed."""
        match = re.fullmatch(rf"({NUMBER})(?: to ({NUMBER}))?", str(self.paper))
        if match is None or (match[2] is None and abs(float(match[1])) in TRIVIAL):
            return None
        low, high = float(match[1]), float(match[2] or match[1])
        half = 0.0 if match[2] else 0.5 * digit(match[1])
        return low - max(PRINTED * abs(low), half), high + max(PRINTED * abs(high), half)

    @property
    def kind(self) -> str:
        """Its class, one of `CLASSES`."""
        if self.timed or self.printed is None:
            return MEASURED if self.timed or self.tolerance is None else CONFIRMED
        return REPRODUCED if self.printed[0] <= self.ours <= self.printed[1] else NOT_REPRODUCED

    @property
    def passed(self) -> bool | None:
        """Whether ours is as it should be; None where nothing is compared or confirmed.

        A printed number that is not reproduced is None with an explanation, and False without.
        """
        if self.kind == MEASURED:
            return None
        low, high = self.tolerance or (None, None)
        below = low is not None and self.ours < low
        if math.isnan(self.ours) or below or (high is not None and self.ours > high):
            return False
        explained = None if self.differs else False
        return explained if self.kind == NOT_REPRODUCED else True

    @property
    def note(self) -> str:
        """The reason to show for the row."""
        return self.differs if self.kind == NOT_REPRODUCED and self.differs else self.why

    def as_json(self) -> dict[str, Any]:
        """For `--json`; a number that could not be found is null."""
        number = self.paper is not None and re.fullmatch(NUMBER, str(self.paper))
        found = asdict(self) | {"class": self.kind, "pass": self.passed}
        found["paper"] = float(self.paper or 0.0) if number else self.paper
        found["ours"] = self.ours if math.isfinite(self.ours) else None
        found["differs"] = self.differs if self.kind == NOT_REPRODUCED else ""
        return found


def count(rows: Iterable[Row]) -> dict[str, int]:
    """Rows of each class, of those reproduced the ones with fitted inputs, and those that fail."""
    found = [*rows]
    counts = {kind: sum(row.kind == kind for row in found) for kind in CLASSES}
    fitted = sum(row.kind == REPRODUCED and bool(row.fitted) for row in found)
    failed = sum(row.passed is False for row in found)
    return {**counts, "of these reproduced with fitted inputs": fitted, "failed": failed}


def row(
    item: str,
    paper: float | str | None,
    ours: float,
    expected: Expected,
    why: str,
    unit: str = "",
    **more: Any,
) -> Row:
    """One row; `more` of `Row`."""
    low, high, reference = (*(expected or (None, None)), None)[:3]
    tolerance = None if expected is None else (low, high)
    return Row(item, paper, float(ours), why, unit, reference, tolerance, **more)


def table(prefix: str, *specs: tuple[Any, ...], **common: Any) -> list[Row]:
    """Rows whose items begin alike, from the arguments of `row`; `common` are those of all."""
    return [row(prefix + str(item), *others, **common) for item, *others in specs]


def like(reference: float, absolute: float | None = None) -> tuple[float, float, float]:
    """What passes next to an oracle's value: within `absolute` or else 2 % of it."""
    width = TOLERANCE * abs(reference) if absolute is None else absolute
    return float(reference - width), float(reference + width), float(reference)


NONE = (0.0, 0.0)
"""Bounds of what must be 0."""


def digit(text: str) -> float:
    """One unit of the last digit of a printed number."""
    mantissa, _, exponent = text.partition("e")
    return float(10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2])))
