"""(15) as an oracle of priorities, without the code that the controller uses."""

from __future__ import annotations

import numpy as np

from hoap3.tools.reproduce.figures import Array
from hoap3.tools.reproduce.papers.ghc.runs import PHASE_S, PHASES

ABOVE = (
    ((0, 1), (0, 2), (1, 2)),
    ((1, 0), (2, 0), (2, 1)),
    ((0, 1), (2, 0), (2, 1)),
    ((2, 0), (1, 0), (1, 1), (1, 2)),
    ((1, 0), (2, 0), (2, 1)),
)
"""Where α is 1, by phase: (i, j) says that task j stands above task i. In the fourth, task 2 is
removed: every task is above it, also itself, and it is above none."""


def hierarchy(phase: int) -> Array:
    """The matrix of a phase, (3, 3)."""
    found = np.zeros((3, 3))
    for pair in ABOVE[phase]:
        found[pair] = 1.0
    return found


def expected(time_s: Array, over_s: float, phase_s: float = PHASE_S) -> Array:
    """The matrix by (15), without the code that the controller uses, (N, 3, 3)."""
    found = np.tile(hierarchy(0), (len(time_s), 1, 1))
    for phase in range(1, len(PHASES)):
        passed = np.clip((time_s - phase * phase_s) / over_s, 0.0, 1.0)
        share = 0.5 - 0.5 * np.cos(np.pi * passed)
        found += share[:, None, None] * (hierarchy(phase) - hierarchy(phase - 1))
    return found
