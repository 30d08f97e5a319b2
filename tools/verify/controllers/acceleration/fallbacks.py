"""What stands in for the optimum where the tasks have none within bounds and torques.

`fallback` 1: the q̈ that is nearest to a wish within bounds and torques. 2: nothing is within both,
which a linear program shows; the bounds are kept, and ½ q̈ᵀH q̈ + fᵀq̈ + ½ P·max H_ii·Σ v² is least,
v_i = max(0, |τ_i| − τ_max)/τ_max, with H = I and f = −wish.
3: the wish, cut to the bounds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from hoap3.tools.verify.claims import RELATIVE, Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.controllers.acceleration.hierarchy import Cycles, Hierarchy

Array = NDArray[np.float64]

NEAREST, OVERLOADED, GAVE_UP = 1, 2, 3
WEIGHTS = 1e4, 1e2, 1.0  # P; the next one where the solver gives up
UNREPEATED = "that a solver finds none, though there may be one, is not repeated"
TINY = 1e-9  # rad/s²: accelerations below it count as that much
BRAKE_PER_S = 10.0  # of −q̇, the wish where the tasks have no answer even with strong motors


class Soft(NamedTuple):
    """Of one cycle: H (n, n) and f (n,), and the wish (n,)."""

    H: Array
    f: Array
    wish: Array


def nearest_to(wish: Array) -> Soft:
    """H = I and f = −wish."""
    return Soft(np.eye(len(wish)), -wish, wish)


def check_fallback(
    run: ControllerRun,
    cycles: Cycles,
    hierarchy: Hierarchy,
    soft: dict[int, Soft],
    claims: Claims,
) -> None:
    """That there was need of one, and that it is what it should be; soft: by cycle."""
    fallback, tick = run.answers["fallback"], run.answers["tick"]
    for i, problem in soft.items():
        if fallback[i] == OVERLOADED:
            least = least_excess(cycles, hierarchy.torque_max, i)
            claims.at_most("fallback: none is within all", tick[i], -least, 0.0, RELATIVE)
        else:
            claims.unverified("fallback: no answer", 1, UNREPEATED)
        off = _distance(cycles, hierarchy.torque_max, i, problem, int(fallback[i]))
        exact = RELATIVE + cycles.ddq_exact[i].max() / _span(cycles.ddq[i], problem)
        claims.at_most("fallback: optimum", tick[i], off, exact, 0.0)


def least_excess(cycles: Cycles, torque_max: Array, i: int) -> float:
    """The least t such that some q̈ within its bounds has |τ| ≤ (1 + t)·τ_max."""
    M, h, n = cycles.mass[i], cycles.bias[i], len(torque_max)
    rows = np.vstack([np.column_stack([M, -torque_max]), np.column_stack([-M, -torque_max])])
    sides = np.concatenate([torque_max - h, torque_max + h])
    ends = np.column_stack([cycles.lower[i], cycles.upper[i]])
    ends[:, 1] = np.maximum(ends[:, 1], ends[:, 0])
    limits = [*map(tuple, ends.tolist()), (None, None)]
    found = linprog(np.append(np.zeros(n), 1.0), rows, sides, bounds=limits, method="highs")
    return float(found.fun) if found.success else np.nan


def _distance(cycles: Cycles, most: Array, i: int, problem: Soft, fallback: int) -> float:
    """How far q̈ is from where it should be, relative to the largest acceleration."""
    ddq, lower, upper = cycles.ddq[i], cycles.lower[i], cycles.upper[i]
    span = _span(ddq, problem)
    if fallback == GAVE_UP:
        return float(np.abs(ddq - np.clip(problem.wish, lower, upper)).max() / span)
    M, tau = cycles.mass[i], cycles.tau[i]
    excess = np.sign(tau) * np.maximum(0.0, np.abs(tau) - most) / most
    over = M[excess != 0.0] / most[excess != 0.0, None]
    found = []
    for P in WEIGHTS:
        stiff = P * float(problem.H.diagonal().max())
        H = problem.H + stiff * over.T @ over
        g = problem.H @ ddq + problem.f + stiff * M.T @ (excess / most)
        D = H.diagonal()
        found.append(float(np.abs(ddq - np.clip(ddq - g / D, lower, upper)).max() / span))
    return min(found)


def _span(ddq: Array, problem: Soft) -> float:
    return float(max(TINY, np.abs(ddq).max(), np.abs(problem.wish).max()))
