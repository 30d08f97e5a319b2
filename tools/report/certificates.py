"""Which answers came with a certificate, and where they did not: counts, first, longest stretch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray
from hoap3.tools.html.numbers import count, least, seconds
from hoap3.tools.show.certificate_count import NAMES, PROVED, STATUS


@dataclass(frozen=True)
class Stretch:
    """Answers without certificate, one after the other.

    Attributes:
        answers: how many.
        tick, begin_s: of the State that the first one answers.
        end_s: of the State that the last one answers; times as in `Certificates`.
    """

    answers: int
    tick: int
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class Certificates:
    """What the answers of one session prove; those of a controller that proves nothing are out.

    Attributes:
        tick: (k,), of the States that were answered.
        time_s: (k,), when, since the first tick that asked.
        status: (k,), one of `STATUS`; a log may hold other numbers, which prove nothing.
        rho: (k,), ρ.
        margin: (k,), smallest true margin, in the unit of its constraint.
        duration_s: of the motion.
        reasons: by status, conditions that held during answers without certificate, or that say
            how little one is worth, and during how many; as `hoap3.tools.show.certificate_count`
            has them.
    """

    tick: NDArray[np.uint64]
    time_s: FloatArray
    status: NDArray[np.uint32]
    rho: FloatArray
    margin: FloatArray
    duration_s: float
    reasons: Mapping[str, Mapping[str, int]] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """Answers that could have had one, k."""
        return len(self.status)

    @cached_property
    def counts(self) -> dict[str, int]:
        """Answers by the name of their status; "unknown" where there are any of that kind."""
        found = {name: int(np.count_nonzero(self.status == STATUS[name])) for name in NAMES}
        unknown = self.n - sum(found.values())
        return {**found, "unknown": unknown} if unknown else found

    @property
    def without(self) -> int:
        """Answers without certificate."""
        return self.n - sum(self.counts[name] for name in PROVED)

    @cached_property
    def stretches(self) -> tuple[Stretch, ...]:
        """Where there was none, in order."""
        missing = ~np.isin(self.status, [STATUS[name] for name in PROVED])
        edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.astype(np.int8), [0]])))
        return tuple(
            Stretch(end - begin, int(self.tick[begin]), *map(float, self.time_s[[begin, end - 1]]))
            for begin, end in edges.reshape(-1, 2).tolist()
        )

    @property
    def longest(self) -> Stretch | None:
        """The stretch with most answers, of several the first; None where all have one."""
        return max(self.stretches, key=lambda stretch: stretch.answers, default=None)

    @property
    def gaps(self) -> list[str]:
        """What the head of the page has to say of it."""
        little = {name: n for status in PROVED for name, n in self.reasons.get(status, {}).items()}
        said = [
            f"In {count(n)} of {count(self.n)} answers a certificate says little: {name}."
            for name, n in little.items()
        ]
        longest = self.longest
        if longest is None:
            return said
        first = self.stretches[0]
        without = (
            f"{count(self.without)} of {count(self.n)} answers came without a certificate, the "
            f"first at tick {first.tick}; the longest stretch has {count(longest.answers)}, from "
            f"{seconds(longest.begin_s)} s on. What V and the constraints do there, nobody has "
            "proved."
        )
        return [without, *said]

    def as_json(self) -> dict[str, Any]:
        """Counts, first and longest stretch, least ρ and margin, as `--json` prints them."""
        longest = self.longest
        return {
            "n": self.n,
            **self.counts,
            "without": self.without,
            "reasons": {status: dict(found) for status, found in self.reasons.items()},
            "stretches": len(self.stretches),
            "first": asdict(self.stretches[0]) if longest else None,
            "longest": asdict(longest) if longest else None,
            "least_rho": least(self.rho),
            "least_margin": least(self.margin),
        }
