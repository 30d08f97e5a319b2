"""The runs of Figs. 1 to 7 once more: gains by `sdp_reference`, in plain numpy.

Each step has B and L by `clik_reference.prioritised`, (3) and (14), and the optimum of (27) within
(21) and (25) by a barrier and Newton's method, proved by its multipliers. No kernel is used.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from hoap3.remote_controller.solvers.clik.clik_reference import certified, prioritised
from hoap3.remote_controller.solvers.sdp.sdp_gains import DELTA
from hoap3.remote_controller.solvers.sdp.sdp_reference import optimum
from hoap3.tools.reproduce.figures import Array
from hoap3.tools.reproduce.papers.sdp import runs

SECONDS = 3.0
EQUAL = np.ones(sum(runs.SIZES))


def scheduled(
    desired: float,
    dt: float = runs.DT_S,
    limit: float = runs.LIMIT_RAD_S,
    seconds: float = SECONDS,
) -> runs.Run:
    """A run with gains that change."""
    most = np.full(runs.JOINTS, limit / desired)

    def step(J: Array, e: Array) -> tuple[Array, float, Array, bool]:
        B, L = prioritised(runs.SIZES, J, EQUAL)
        scale, beta, proved = optimum(L, B * e, -most, most, dt * desired, DELTA)
        gains = desired * scale
        return gains, desired * beta, B @ (gains * e), proved

    return runs.follow(step, dt, limit, desired, seconds)


def constant() -> runs.Run:
    """The run with gains that stay."""
    gains = np.array(runs.CONSTANT)

    def step(J: Array, e: Array) -> tuple[Array, float, Array, bool]:
        B, L = prioritised(runs.SIZES, J, EQUAL)
        return gains, certified(L, gains, runs.DT_S), B @ (gains * e), True

    return runs.follow(step, seconds=SECONDS)


@cache
def run_all() -> runs.Runs:
    """All of them."""
    return runs.run_all(scheduled, constant)
