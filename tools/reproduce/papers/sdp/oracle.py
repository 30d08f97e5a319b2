"""The runs of Figs. 1 to 7 once more: gains by `sdp_reference`, in plain numpy.

Each step has B and L by `clik_reference.prioritised`, (3) and (14), and the optimum of (27) within
(21) and (25) by a barrier and Newton's method, proved by its multipliers. No kernel is used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from hoap3.remote_controller.solvers.clik.clik_reference import certified, prioritised
from hoap3.remote_controller.solvers.sdp.sdp_gains import DELTA
from hoap3.remote_controller.solvers.sdp.sdp_reference import optimum
from hoap3.tools.reproduce.figures import Array
from hoap3.tools.reproduce.papers.sdp.arm import JOINTS, SIZES, START, toolbox
from hoap3.tools.reproduce.papers.sdp.loop import Run
from hoap3.tools.reproduce.papers.sdp.reference import (
    CONSTANT,
    DT_S,
    FAST,
    LIMIT_RAD_S,
    LOW_LIMIT_RAD_S,
    PERIODS_S,
    SLOW,
)
from hoap3.tools.reproduce.papers.sdp.runs import Runs

SECONDS = 3.0


def scheduled(
    desired: float,
    dt: float = DT_S,
    limit: float = LIMIT_RAD_S,
    seconds: float = SECONDS,
    weights: Sequence[float] = (1.0, 1.0, 1.0, 1.0),
    delta: float = DELTA,
) -> Run:
    """A run with gains that change."""
    most = np.full(JOINTS, limit / desired)
    root = np.sqrt(np.array(weights))

    def gains(B: Array, L: Array, e: Array) -> tuple[Array, float, bool]:
        scale, beta, proved = optimum(L, B * e, -most, most, dt * desired, delta)
        return desired * scale, desired * beta, proved

    return _go(dt, desired, limit, seconds, root**2, gains)


def constant() -> Run:
    """The run with gains that stay."""

    def gains(_: Array, L: Array, _e: Array) -> tuple[Array, float, bool]:
        return np.array(CONSTANT), certified(L, np.array(CONSTANT), DT_S), True

    return _go(DT_S, 0.0, np.inf, SECONDS, np.ones(len(CONSTANT)), gains)


@cache
def run_all() -> Runs:
    """All but the one at 1 kHz."""
    fast = scheduled(FAST)
    periods = {dt: fast if dt == DT_S else scheduled(FAST, dt) for dt in PERIODS_S}
    limited = scheduled(FAST, limit=LOW_LIMIT_RAD_S)
    return Runs(constant(), scheduled(SLOW), fast, limited, periods, fast)


def _go(
    dt: float,
    desired: float,
    limit: float,
    seconds: float,
    weights: Array,
    gains_of: Callable[[Array, Array, Array], tuple[Array, float, bool]],
) -> Run:
    steps, tasks, q = round(seconds / dt) + 1, toolbox(), START.copy()
    errors, gains = np.zeros((2, steps, sum(SIZES)))
    beta, dq, proved = np.zeros(steps), np.zeros((steps, JOINTS)), np.zeros(steps, np.bool_)
    for k in range(steps):
        J, errors[k] = tasks(q)
        B, L = prioritised(SIZES, J, weights)
        gains[k], beta[k], proved[k] = gains_of(B, L, errors[k])
        dq[k] = B @ (gains[k] * errors[k])
        q = q + dt * dq[k]
    paths = np.zeros(steps, np.int64)
    return Run(dt, desired, np.full(JOINTS, limit), weights, errors, beta, gains, dq, paths, proved)
