"""Rows of a reproduction: what a paper says, what we find, and whether that is as it should be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

TOLERANCE = 0.02
"""Relative, where nothing else is said."""

Bounds = tuple[float | None, float | None]


@dataclass(frozen=True)
class Row:
    """A figure of a paper beside ours.

    Attributes:
        item: what it is, and in which figure or table.
        paper: as printed: a number, words, or None where the paper says nothing.
        ours: found in this run.
        unit: of both.
        reference: what the equations give by an independent computation: a number, a range, or
            None where nothing is known but bounds.
        tolerance: least and greatest value of `ours` that pass, None for no bound; None for a
            measurement, which neither passes nor fails.
        why: the reason where paper and ours differ, or what was counted.
    """

    item: str
    paper: float | str | None
    ours: float
    unit: str
    reference: float | tuple[float, float] | None
    tolerance: Bounds | None
    why: str

    @property
    def passed(self) -> bool | None:
        """Whether ours is within the tolerance; None for a measurement."""
        if self.tolerance is None:
            return None
        low, high = self.tolerance
        above = -math.inf if low is None else low
        below = math.inf if high is None else high
        return above <= self.ours <= below

    def as_json(self) -> dict[str, Any]:
        """For `--json`; a figure that could not be found is null."""
        return {
            "item": self.item,
            "paper": self.paper,
            "ours": self.ours if math.isfinite(self.ours) else None,
            "unit": self.unit,
            "reference": self.reference,
            "tolerance": self.tolerance,
            "pass": self.passed,
            "why": self.why,
        }


def near(
    item: str,
    paper: float | str | None,
    ours: float,
    reference: float,
    why: str,
    *,
    unit: str = "",
    absolute: float | None = None,
) -> Row:
    """Ours must be as the reference, within `absolute` or else 2 % of it."""
    width = TOLERANCE * abs(reference) if absolute is None else absolute
    bounds = (reference - width, reference + width)
    return Row(item, paper, float(ours), unit, reference, bounds, why)


def between(
    item: str,
    paper: float | str | None,
    ours: float,
    reference: tuple[float, float],
    why: str,
    *,
    unit: str = "",
) -> Row:
    """Ours must be in a range that the reference run gives, or within 2 % of its ends."""
    low, high = reference
    bounds = (low - TOLERANCE * abs(low), high + TOLERANCE * abs(high))
    return Row(item, paper, float(ours), unit, reference, bounds, why)


def bounded(
    item: str,
    paper: float | str | None,
    ours: float,
    bounds: Bounds,
    why: str,
    *,
    unit: str = "",
) -> Row:
    """Ours must keep a bound that a theorem or the paper's words set."""
    return Row(item, paper, float(ours), unit, None, bounds, why)


def measured(item: str, paper: float | None, ours: float, why: str, *, unit: str = "") -> Row:
    """A measurement of this machine, which nobody may judge."""
    return Row(item, paper, float(ours), unit, None, None, why)
