"""The UR5 of Marti-Saumell et al., V: standard DH, hand position, wrist's y; the closed loop.

Frames as in Corke's toolbox, without a base rotation; the wrist is the origin of DH frame 4.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hoap3.remote_controller.solvers.clik.clik_reference import certified, prioritised
from hoap3.remote_controller.solvers.sdp.sdp_gains import SdpGains

A = (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)
D = (0.089459, 0.0, 0.0, 0.10915, 0.09465, 0.0823)
ALPHA = np.radians([90, 0, 0, 90, -90, 0])
START = np.radians([135.0, 0, -90, 0, 90, 0])
HAND, WRIST_Y = np.array([-0.5, -0.4, 0.6]), -0.3
SIZES = (3, 1)


def tasks(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stacked Jacobian, (4, 6), and errors, (4,)."""
    T, axes, origins, frames = np.eye(4), [], [], []
    for angle, a, d, alpha in zip(q, A, D, ALPHA, strict=True):
        axes.append(T[:3, 2].copy())
        origins.append(T[:3, 3].copy())
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        T = T @ np.array(
            [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        )
        frames.append(T[:3, 3].copy())
    hand, wrist = frames[5], frames[3]
    J = np.zeros((4, 6))
    for i in range(6):
        J[:3, i] = np.cross(axes[i], hand - origins[i])
        if i < 4:
            J[3, i] = np.cross(axes[i], wrist - origins[i])[1]
    return J, np.array([*(HAND - hand), WRIST_Y - wrist[1]])


@dataclass
class Run:
    """What happened at each step."""

    V: list[float] = field(default_factory=list)
    beta: list[float] = field(default_factory=list)
    actual: list[float] = field(default_factory=list)
    gains: list[np.ndarray] = field(default_factory=list)
    dq: list[np.ndarray] = field(default_factory=list)
    paths: list[int] = field(default_factory=list)
    slack: list[float] = field(default_factory=list)
    gap: list[float] = field(default_factory=list)
    problems: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)


def simulate(desired: float, dt: float = 0.01, limit: float = 6.0, seconds: float = 3.0) -> Run:
    """Euler's method in closed loop."""
    solver, q, run = SdpGains(SIZES, 6), START.copy(), Run()
    solver.lower[:], solver.upper[:] = -limit, limit
    for _ in range(round(seconds / dt) + 1):
        J, e = tasks(q)
        solver.solve(J, e, dt, desired)
        run.V.append(0.5 * e @ e)
        run.beta.append(solver.beta)
        run.gains.append(solver.gains.copy())
        run.dq.append(solver.dq.copy())
        run.paths.append(solver.path)
        run.slack.append(solver.slack)
        run.gap.append(solver.gap)
        run.problems.append((J, e))
        q = q + dt * solver.dq
    run.actual = [(1 - after / now) / dt for now, after in zip(run.V, run.V[1:], strict=False)]
    return run


def constant(gains: np.ndarray, dt: float = 0.01, seconds: float = 3.0) -> Run:
    """The same with gains that stay as they are."""
    q, run = START.copy(), Run()
    for _ in range(round(seconds / dt) + 1):
        J, e = tasks(q)
        B, L = prioritised((3, 1), J, np.ones(4))
        run.beta.append(certified(L, gains, dt))
        run.V.append(0.5 * e @ e)
        run.dq.append(B @ (gains * e))
        q = q + dt * run.dq[-1]
    return run
