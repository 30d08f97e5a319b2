"""Where the constraints leave less than ζ along a curve: the speed that is taken instead of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hoap3.tools.verify.claims import Claims
from support.oracles.stable_qp_arrays import farkas
from support.oracles.stable_qp_arrays.problem import Cycle

Array = NDArray[np.float64]

SPARED = 0.1  # of the speeds that constraints leave, at each end where ζ is beyond it
AS_CONFIGURED = 1e-9  # of the row's length: what misses ζ by less keeps it [rad/s or m/s]


def with_speeds(
    chunk: Sequence[Cycle],
    u: Array,
    doubt: Array,
    kept: Array,
    tick: NDArray[np.int64],
    claims: Claims,
) -> list[Cycle]:
    """The cycles of a curve, with the speed that they took where they are slower than ζ.

    Args:
        chunk: cycles; the last of their equations is the motion along the curve.
        u, doubt: their answers, and how exactly they are known, (N, n).
        kept: what they may be beyond a side of length 1, (N,).
        tick: of the cycles, (N,).
        claims: takes whether it is the speed that constraints leave.
    """
    found = []
    for i, cycle in enumerate(chunk):
        row, speed = cycle.C[-1], float(cycle.c[-1])
        size, taken = float(np.linalg.norm(row)), float(row @ u[i])
        near = AS_CONFIGURED * size + float(np.abs(row) @ doubt[i])
        if abs(taken - speed) > near:
            left, pull = _left(cycle, size or 1.0)
            near += size * float(kept[i]) * (1.0 + pull)
            claims.equal("speed along the curve", tick[i], taken, left, near)
            found.append(replace(cycle, c=np.append(cycle.c[:-1], taken)))
        else:
            found.append(cycle)
    return found


def _left(cycle: Cycle, size: float) -> tuple[float, float]:
    """The speed next to ζ of those that the constraints leave, but for some at an end.

    And by how much it changes, in units of the row, where sides give way by 1.
    """
    row, speed = cycle.C[-1] / size, float(cycle.c[-1])
    A, b, C, c = cycle.A, cycle.b, cycle.C[:-1], cycle.c[:-1]
    sides = farkas.Sides(A, b, C, c, cycle.lower, cycle.upper)
    slowest, fastest = farkas.most(-row, sides), farkas.most(row, sides)
    least, most = -size * slowest.bound, size * fastest.bound
    if most == -np.inf:
        return speed, 0.0
    room = min(most - least, 2.0 * most, 2.0 * max(abs(least), speed))
    spared = SPARED * max(room, 0.0)
    left = min(max(speed, least + spared), most - spared)
    return left, (1.0 + 2.0 * SPARED) * max(slowest.pull, fastest.pull)
