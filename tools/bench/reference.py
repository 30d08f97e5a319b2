"""A fixed piece of work: its time says how fast this machine is just now, and nothing of us."""

from __future__ import annotations

import numpy as np

from hoap3.tools.bench.timing import Contender

REPETITIONS = 20


def reference() -> Contender:
    """Twenty rounds of a Python loop with a product of a 21 × 21 matrix and a vector in each."""
    matrix, vector, out = np.full((21, 21), 0.5), np.ones(21), np.zeros(21)

    def work() -> int:
        total = 0
        for k in range(REPETITIONS):
            total += k * k
            np.dot(matrix, vector, out)
        return total

    return Contender("reference", work, [()])
