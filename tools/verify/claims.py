"""Collects what was found true, what was found false, and what could not be verified.

A claim is one number of one cycle, such as V of tick 120. It holds where what the log states and
what was recomputed differ by no more than a tolerance. What could not be recomputed is counted
with its reason, and never passes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

RELATIVE = 1e-9
"""Difference that counts as rounding, relative to the size of what is compared."""

MOST_LISTED = 1000
"""False claims that are listed one by one; all are counted."""


@dataclass(frozen=True)
class FalseClaim:
    """A number that is not what it should be.

    Attributes:
        tick: of the cycle.
        claim: what is claimed, such as "V".
        stated: in the log.
        found: what was recomputed; for a bound, the bound.
        tolerance: difference that would have passed.
    """

    tick: int
    claim: str
    stated: float
    found: float
    tolerance: float


@dataclass
class Count:
    """Of one claim over all cycles.

    Attributes:
        checked: how often it was recomputed.
        false: how often it does not hold.
        first_false: lowest tick of those, or None.
        largest: the greatest difference, as a multiple of its tolerance.
        unverified: how often it could not be recomputed, by reason.
    """

    checked: int = 0
    false: int = 0
    first_false: int | None = None
    largest: float = 0.0
    unverified: dict[str, int] = field(default_factory=dict)


class Claims:
    """All claims of one log.

    Attributes:
        counts: by claim.
        listed: false claims, at most `MOST_LISTED`, in the order in which they were found.
        answers, left_out: answers whose certificates are checked by samples, and how many of these
            are not in the sample.
    """

    def __init__(self) -> None:
        self.counts: dict[str, Count] = {}
        self.listed: list[FalseClaim] = []
        self.answers = self.left_out = 0
        self._from: int | None = None

    @contextmanager
    def from_tick(self, tick: int) -> Iterator[None]:
        """Meanwhile nothing of earlier ticks is taken: they stand only before those that count."""
        self._from = tick
        try:
            yield
        finally:
            self._from = None

    def equal(
        self,
        claim: str,
        ticks: ArrayLike,
        stated: ArrayLike,
        found: ArrayLike,
        tolerance: ArrayLike | None = None,
    ) -> None:
        """Each stated number is what was found.

        Args:
            claim: what is claimed.
            ticks: of the cycles, (N,) or one.
            stated, found: (N,) or (N, m); two that are nan are equal.
            tolerance: by default `RELATIVE` of the larger one's size.
        """
        stated, found = np.atleast_1d(stated).astype(float), np.atleast_1d(found).astype(float)
        if tolerance is None:
            tolerance = RELATIVE * np.maximum(np.abs(stated), np.abs(found))
        off = np.abs(stated - found)
        off[(stated == found) | (np.isnan(stated) & np.isnan(found))] = 0.0
        self._take(claim, ticks, stated, found, off, tolerance)

    def at_most(
        self, claim: str, ticks: ArrayLike, value: ArrayLike, bound: ArrayLike, tolerance: ArrayLike
    ) -> None:
        """No value exceeds its bound; arguments as for `equal`."""
        value, bound = np.broadcast_arrays(np.atleast_1d(value), bound)
        value, bound = value.astype(float), bound.astype(float)
        with np.errstate(invalid="ignore"):
            off = np.where(value <= bound, 0.0, value - bound)  # nan stays nan
        self._take(claim, ticks, value, bound, off, tolerance)

    def compared(
        self,
        claim: str,
        ticks: ArrayLike,
        stated: NDArray[np.float64],
        found: NDArray[np.float64],
        off: NDArray[np.float64],
        tolerance: ArrayLike,
    ) -> None:
        """Take what was compared already: by how much it is off, and by how much it may be."""
        self._take(claim, ticks, stated, found, off, tolerance)

    def unverified(self, claim: str, cycles: int, reason: str) -> None:
        """So many cycles' claim could not be recomputed."""
        if cycles:
            reasons = self._count(claim).unverified
            reasons[reason] = reasons.get(reason, 0) + cycles

    def add(self, other: Claims) -> None:
        """Add all claims of another part of the log."""
        for name, each in other.counts.items():
            count = self._count(name)
            count.checked += each.checked
            count.false += each.false
            count.largest = max(count.largest, each.largest)
            ticks = [tick for tick in (count.first_false, each.first_false) if tick is not None]
            count.first_false = min(ticks, default=None)
            for reason, cycles in each.unverified.items():
                self.unverified(name, cycles, reason)
        self.listed += other.listed[: MOST_LISTED - len(self.listed)]
        self.answers += other.answers
        self.left_out += other.left_out

    @property
    def checked(self) -> int:
        """Numbers that were recomputed."""
        return sum(count.checked for count in self.counts.values())

    @property
    def false(self) -> int:
        """Numbers that are not what they should be."""
        return sum(count.false for count in self.counts.values())

    @property
    def unverifiable(self) -> int:
        """How often something could not be recomputed."""
        return sum(sum(count.unverified.values()) for count in self.counts.values())

    def by_tick(self) -> list[FalseClaim]:
        """The listed false claims, by tick."""
        return sorted(self.listed, key=lambda one: one.tick)

    def as_json(self) -> dict[str, Any]:
        """All counts, and the false claims by tick."""
        return {
            "checked": self.checked,
            "false": self.false,
            "unverified": self.unverifiable,
            "left_out": self.left_out,
            "claims": {name: asdict(count) for name, count in sorted(self.counts.items())},
            "false_claims": [asdict(one) for one in self.by_tick()],
        }

    def _count(self, claim: str) -> Count:
        return self.counts.setdefault(claim, Count())

    def _take(
        self,
        claim: str,
        ticks: ArrayLike,
        stated: NDArray[np.float64],
        found: NDArray[np.float64],
        off: NDArray[np.float64],
        tolerance: ArrayLike,
    ) -> None:
        if not stated.size:
            return
        at = np.broadcast_to(np.asarray(ticks, np.int64), (len(stated),))
        allowed = np.broadcast_to(np.asarray(tolerance, float), off.shape)
        found = np.broadcast_to(found, stated.shape)
        if self._from is not None:
            later = at >= self._from
            at, allowed, off = at[later], allowed[later], off[later]
            stated, found = stated[later], found[later]
            if not stated.size:
                return
        count = self._count(claim)
        count.checked += stated.size
        if not off.any():
            return
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            share = np.where(off == 0.0, 0.0, off / allowed)
        share = np.where(np.isnan(share), np.inf, share)
        count.largest = max(count.largest, float(share.max()))
        wrong = np.argwhere(share > 1.0)
        if not len(wrong):
            return
        count.false += len(wrong)
        first = int(at[wrong[:, 0]].min())
        count.first_false = first if count.first_false is None else min(count.first_false, first)
        for place in wrong[: MOST_LISTED - len(self.listed)]:
            where = tuple(place.tolist())
            numbers = float(stated[where]), float(found[where]), float(allowed[where])
            self.listed.append(FalseClaim(int(at[where[0]]), claim, *numbers))
