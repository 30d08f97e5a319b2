"""How far V's fall is from the largest one that the constraints leave, min(1, ρ*) of (6).

At the largest fall itself the feasible set is a point, which rounding may remove: `stable_qp`
stays inside it by one of `RUNGS`, the first for which a solver has an answer.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from support.oracles.stable_qp_arrays.farkas import Most
from support.oracles.stable_qp_arrays.scaled import Scaled

RUNGS = 1e-9, 1e-7, 1e-5, 1e-3  # of the largest fall
KEPT = 1e-9  # rad/s or m/s: what a certified answer may be beyond a side of length 1,
SOLVED = 1e-8  # and any other, to which `stable_qp` takes a solver's word


class Missing(NamedTuple):
    """What V's fall lacks, and how exactly that is known."""

    fall: float = 0.0
    exact: float = 0.0

    @property
    def nothing(self) -> bool:
        """Whether that is the case."""
        return self.fall <= self.exact


def missing(p: Scaled, most: Most, kept: float) -> Missing:
    """What the fall lacks of the largest one, or of what is wanted, but for the nearest rung.

    It is known to what sides that give way by `kept` make of it, and the rounding of slope and y.
    """
    best = min(most.bound, p.wanted)
    if not np.isfinite(best):
        return Missing(np.inf)
    lacks, size = best - p.fall, abs(best)
    beside = [abs(lacks - rung * size) for rung in RUNGS[1:]]
    span = max(most.span, float(np.abs(p.y).max()))
    rounding = float(np.abs(p.slope) @ p.doubt) + 2.0 * span * float(p.slope_doubt.sum())
    return Missing(
        min(max(lacks - RUNGS[0] * size, 0.0), *beside),
        kept * (1.0 + most.pull) + rounding,
    )
