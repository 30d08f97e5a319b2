"""The closed loop of the paper: gains, joint speeds, and Euler's method, (5) and (7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.clik.constant_gains import ConstantGains
from hoap3.remote_controller.solvers.sdp.sdp_gains import PATHS, SdpGains
from hoap3.tools.reproduce.figures import Array
from hoap3.tools.reproduce.papers.sdp.arm import JOINTS, SIZES, START, Tasks, toolbox
from hoap3.tools.reproduce.papers.sdp.reference import CONSTANT, DT_S, LIMIT_RAD_S

SECONDS = 4.0  # that the paper shows
AT_LIMIT = 1e-6  # rad/s


@dataclass(frozen=True, eq=False)
class Run:
    """What happened, one row a step of N.

    Attributes:
        dt: Δt [s].
        desired: β̃ [1/s]; 0 for constant gains.
        limit: of joint speeds, (joints,) [rad/s].
        weights: w of V, (n,).
        errors: σ* − σ, (N, n) [m or rad].
        beta: β [1/s] that the gains certify, (N,).
        gains: λ, (N, n) [1/s].
        dq: (N, joints) [rad/s].
        paths: of the solver, index into its `PATHS`, (N,).
        proved: whether the gains are proved to be optimal, (N,).
    """

    dt: float
    desired: float
    limit: Array
    weights: Array
    errors: Array
    beta: Array
    gains: Array
    dq: Array
    paths: NDArray[np.int64]
    proved: NDArray[np.bool_]

    @property
    def time_s(self) -> Array:
        """Since the start, (N,)."""
        return np.arange(len(self.beta), dtype=np.float64) * self.dt

    @cached_property
    def v(self) -> Array:
        """V = ½ Σ w e², (N,)."""
        found: Array = 0.5 * (self.errors**2 @ self.weights)
        return found

    @property
    def actual(self) -> Array:
        """(1 − V⁺/V)/Δt [1/s], the rate at which V falls in fact, (N − 1,)."""
        found: Array = (1.0 - self.v[1:] / self.v[:-1]) / self.dt
        return found

    @property
    def behind(self) -> int:
        """Steps in which V falls more slowly than β says."""
        return int((self.actual < self.beta[:-1]).sum())

    @property
    def rise(self) -> float:
        """Greatest V⁺/V; V never increases up to 1."""
        return float((self.v[1:] / self.v[:-1]).max())

    @property
    def excess(self) -> float:
        """By how much a joint is too fast [rad/s]; up to 0 none is."""
        return float((np.abs(self.dq) - self.limit).max())

    @property
    def held(self) -> int:
        """Steps with a joint at its limit."""
        return int((np.abs(self.dq) > self.limit - AT_LIMIT).any(axis=1).sum())

    def at(self, time_s: float) -> int:
        """Number of the step at a time."""
        return round(time_s / self.dt)

    def count(self, path: str) -> int:
        """Steps that took a path."""
        return int((self.paths == PATHS.index(path)).sum())


def follow(
    tasks: Tasks,
    start: Array,
    solver: SdpGains | ConstantGains,
    dt: float,
    desired: float = 0.0,
    seconds: float = SECONDS,
) -> Run:
    """Go from `start` by Euler's method.

    Args:
        tasks: what shall be done.
        start: joint positions, (joints,) [rad].
        solver: of the gains, with its limits.
        dt, desired: Δt [s], β̃ [1/s].
        seconds: how long.
    """
    steps, q = round(seconds / dt) + 1, np.array(start, dtype=np.float64)
    errors, gains = np.zeros((2, steps, solver.n))
    beta, dq = np.zeros(steps), np.zeros((steps, q.size))
    paths, proved = np.zeros(steps, np.int64), np.zeros(steps, np.bool_)
    for k in range(steps):
        J, errors[k] = tasks(q)
        if isinstance(solver, SdpGains):
            solver.solve(J, errors[k], dt, desired)
            paths[k] = solver.path
        else:
            solver.solve(J, errors[k], dt)
        gains[k], beta[k], dq[k] = solver.gains, solver.beta, solver.dq
        proved[k] = solver.status == status.OK
        q = q + dt * solver.dq
    limit, weights = solver.upper.copy(), solver.weights.copy()
    return Run(dt, desired, limit, weights, errors, beta, gains, dq, paths, proved)


def scheduled(
    desired: float,
    dt: float = DT_S,
    limit: float = LIMIT_RAD_S,
    seconds: float = SECONDS,
    *,
    tasks: Tasks | None = None,
    weights: Sequence[float] | None = None,
) -> Run:
    """The UR5 with gains by semidefinite programming; `tasks` are the paper's by default."""
    solver = SdpGains(SIZES, JOINTS, weights=weights)
    solver.lower[:], solver.upper[:] = -limit, limit
    return follow(tasks or toolbox(), START, solver, dt, desired, seconds)


def constant(seconds: float = SECONDS) -> Run:
    """The UR5 with the paper's constant gains, and without limits."""
    solver = ConstantGains(SIZES, JOINTS, CONSTANT)
    return follow(toolbox(), START, solver, DT_S, seconds=seconds)
