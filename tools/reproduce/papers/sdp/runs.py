"""The UR5 of the paper: its two tasks, and closed loops by Euler's method, (5) and (7).

The toolbox that the paper names has the arm in the standard convention of Denavit and Hartenberg,
and the code of its authors takes the origin of frame {4} for the fourth joint. The paper's start
and targets fit that, and do not fit a base that is turned by 180°, as that of ROS. The paper prints
settings, section V, and results as curves without numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.clik.constant_gains import ConstantGains
from hoap3.remote_controller.solvers.sdp.sdp_gains import DELTA, SdpGains
from hoap3.tools.reproduce.figures import Array

A = (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)
D = (0.089459, 0.0, 0.0, 0.10915, 0.09465, 0.0823)
ALPHA = np.radians([90.0, 0.0, 0.0, 90.0, -90.0, 0.0])
JOINTS, WRIST = len(A), 4
SIZES = (3, 1)
START = np.radians([135.0, 0.0, -90.0, 0.0, 90.0, 0.0])
HAND_M, WRIST_Y_M = np.array([-0.5, -0.4, 0.6]), -0.3

SECONDS = 4.0  # that the paper shows
DT_S, LIMIT_RAD_S = 0.01, 6.0
CONSTANT = (2.0, 2.0, 2.0, 1.0)
"""Constant gains [1/s]."""

SLOW, FAST = 2.0, 8.0
"""β̃ of the paper [1/s]."""

LOW_LIMIT_RAD_S = 4.0
"""The other limit of Fig. 5."""

PERIODS_S = (0.1, 0.05, 0.01, 0.005)
"""Δt of Figs. 6 and 7, the default one among them."""

AT_LIMIT = 1e-6  # rad/s

Step = Callable[[Array, Array], tuple[Array, float, Array, bool]]
"""From J and the errors: gains, β, joint speeds, and whether the gains are proved to be optimal."""


def tasks(q: Array) -> tuple[Array, Array]:
    """Stacked Jacobian (4, joints) and errors σ* − σ (4,) of the hand's place and the wrist's y."""
    axes, origins = frames(q)
    J = np.zeros((4, JOINTS))
    J[:3] = np.cross(axes[:-1], origins[-1] - origins[:-1]).T
    J[3, :WRIST] = np.cross(axes[:WRIST], origins[WRIST] - origins[:WRIST])[:, 1]
    return J, np.array([*(HAND_M - origins[-1]), WRIST_Y_M - origins[WRIST, 1]])


def frames(q: Array) -> tuple[Array, Array]:
    """Axes z and origins of the frames {0} to {6}, (7, 3) each [1, m], in the axes of {0}."""
    T = np.eye(4)
    axes, origins = np.zeros((2, JOINTS + 1, 3))
    axes[0] = T[:3, 2]
    for i, (angle, a, d, alpha) in enumerate(zip(q, A, D, ALPHA, strict=True), 1):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        T = T @ np.array(
            [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        )
        axes[i], origins[i] = T[:3, 2], T[:3, 3]
    return axes, origins


@dataclass(frozen=True, eq=False)
class Run:
    """One run, one row a step of N.

    Attributes:
        dt: Δt [s].
        desired: β̃ [1/s]; 0 for constant gains.
        limit: of joint speeds [rad/s].
        errors: σ* − σ, (N, 4) [m].
        beta: β [1/s] that the gains certify, (N,).
        gains: λ, (N, 4) [1/s].
        dq: (N, joints) [rad/s].
        proved: whether the gains are proved to be optimal, (N,).
    """

    dt: float
    desired: float
    limit: float
    errors: Array
    beta: Array
    gains: Array
    dq: Array
    proved: NDArray[np.bool_]

    @property
    def time_s(self) -> Array:
        """Since the start, (N,)."""
        return np.arange(len(self.beta), dtype=np.float64) * self.dt

    @property
    def v(self) -> Array:
        """V = ½|e|², (N,)."""
        return np.asarray(0.5 * (self.errors**2).sum(axis=1))

    @property
    def wrist(self) -> Array:
        """|e₂|, (N,) [m]."""
        return np.abs(self.errors[:, 3])

    @property
    def behind(self) -> int:
        """Steps in which V falls more slowly than β certifies."""
        return int(((1.0 - self.v[1:] / self.v[:-1]) / self.dt < self.beta[:-1]).sum())

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


def follow(
    step: Step,
    dt: float = DT_S,
    limit: float = np.inf,
    desired: float = 0.0,
    seconds: float = SECONDS,
) -> Run:
    """Go from the paper's start by Euler's method; arguments as in `Run`."""
    q, found = START.copy(), []
    for _ in range(round(seconds / dt) + 1):
        J, errors = tasks(q)
        gains, beta, dq, proved = step(J, errors)
        found.append((errors, beta, gains.copy(), dq.copy(), proved))
        q = q + dt * dq
    return Run(dt, desired, limit, *map(np.array, zip(*found, strict=True)))


def scheduled(
    desired: float,
    dt: float = DT_S,
    limit: float = LIMIT_RAD_S,
    seconds: float = SECONDS,
    delta: float = DELTA,
) -> Run:
    """A run with gains by semidefinite programming, δ of (27)."""
    solver = SdpGains(SIZES, JOINTS)
    solver.lower[:], solver.upper[:] = -limit, limit

    def step(J: Array, errors: Array) -> tuple[Array, float, Array, bool]:
        solver.solve(J, errors, dt, desired, delta)
        return solver.gains, solver.beta, solver.dq, solver.status == status.OK

    return follow(step, dt, limit, desired, seconds)


def constant() -> Run:
    """The run with the paper's constant gains, without limits."""
    solver = ConstantGains(SIZES, JOINTS, CONSTANT)

    def step(J: Array, errors: Array) -> tuple[Array, float, Array, bool]:
        solver.solve(J, errors, DT_S)
        return solver.gains, solver.beta, solver.dq, solver.status == status.OK

    return follow(step)


@dataclass(frozen=True)
class Runs:
    """All runs.

    Attributes:
        constant, slow, fast: of Figs. 1 to 4: constant gains, β̃ = 2 and 8.
        limited: of Fig. 5, with the lower limit.
        periods: of Figs. 6 and 7, by Δt [s]; `fast` is among them.
    """

    constant: Run
    slow: Run
    fast: Run
    limited: Run
    periods: Mapping[float, Run]

    @property
    def scheduled(self) -> dict[str, Run]:
        """Those with a certificate, by name."""
        named = {f"β̃ = {SLOW:g}": self.slow, f"β̃ = {FAST:g}": self.fast}
        named[f"β̃ = {FAST:g}, {LOW_LIMIT_RAD_S:g} rad/s"] = self.limited
        others = {dt: run for dt, run in self.periods.items() if run is not self.fast}
        return named | {f"β̃ = {FAST:g}, Δt = {dt:g} s": run for dt, run in others.items()}


def run_all(
    scheduled: Callable[..., Run] = scheduled, constant: Callable[[], Run] = constant
) -> Runs:
    """The runs behind Figs. 1 to 7, with the solvers of the controllers or those of `oracle`."""
    fast = scheduled(FAST)
    periods = {dt: fast if dt == DT_S else scheduled(FAST, dt) for dt in PERIODS_S}
    limited = scheduled(FAST, limit=LOW_LIMIT_RAD_S)
    return Runs(constant(), scheduled(SLOW), fast, limited, periods)
