"""Hierarchies of tasks along motions of shipped robots, and (13) for other people's solvers.

k tasks are the positions of k − 1 frames, strictly one below the other, and the posture below all.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.description import RobotDescription
from hoap3.remote_controller.model.frame_dynamics import FrameDynamics
from hoap3.remote_controller.solvers import generalized_projector
from hoap3.remote_controller.solvers.qp.qp_backends import EQUATION, NO_BOUND, Program
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.robots.urdf_import.imported import import_robot

Array = NDArray[np.float64]

FRAMES = {
    "lwr": ("ee", "elbow", "link_6", "link_3", "link_5", "link_2"),
    "humanoid32": ("r_palm", "l_palm", "r_sole", "l_sole", "head", "chest"),
    "icub": ("r_gripper", "l_gripper", "r_sole", "l_sole", "head", "chest"),
}
VENDORS = {"icub": ("example-robot-data", "icub_description/robots/icub.urdf")}
"""Robots whose own URDF is read from a package, where that is installed."""

STATES = 32
W_R = 1e-2
HELD, STRAINED = 0.3, 0.2  # bounds, of the largest acceleration and effort that the tasks ask for


@dataclass(frozen=True)
class Moment:
    """A robot at one time: Jacobians of all frames, (3, n) each, and its dynamics."""

    jacobians: list[Array]
    mass: Array
    bias: Array
    wanted: list[Array]
    posture: Array


@dataclass(frozen=True)
class Problem:
    """One hierarchy: the arguments of `Ghc.solve` before ω_r, and rows of each task."""

    sizes: list[int]
    jacobian: Array
    targets: Array
    alpha: Array
    mass: Array
    bias: Array


@dataclass
class Lqp(Program):
    """(13), q̈ = motion·x; the last n of x are torques, with bounds of their own."""

    motion: Array


def missing() -> dict[str, str]:
    """Robots whose package is not installed, and that package."""
    return {robot: package for robot, (package, _) in VENDORS.items() if _urdf(robot) is None}


def _urdf(robot: str) -> Path | None:
    """The file of a vendor's robot, or None where its package is not installed."""
    package, name = VENDORS[robot]
    try:
        wheel = distribution(package)
    except PackageNotFoundError:
        return None
    found = (wheel.locate_file(file) for file in wheel.files or [] if str(file).endswith(name))
    return next((Path(str(file)) for file in found), None)


def _described(robot: str) -> RobotDescription:
    urdf = _urdf(robot) if robot in VENDORS else None
    return load(robot) if urdf is None else import_robot(urdf).description


def moments(robot: str, seed: int = 0) -> list[Moment]:
    """A slow random walk of a robot from its initial posture, to and fro."""
    description, rng = _described(robot), np.random.default_rng(seed)
    n, frames = description.n, [FrameDynamics(description, name) for name in FRAMES[robot]]
    walk = np.cumsum(rng.normal(scale=0.03, size=(STATES // 2, n)), axis=0)
    q = np.array(description.initial_position) + rng.normal(scale=0.3, size=n) + walk
    dq = 0.3 * np.cumsum(rng.normal(scale=0.3, size=q.shape), axis=0)
    found = []
    for posture, speed in zip(q, dq, strict=True):
        for frame in frames:
            frame.update(posture, speed)
        found.append(
            Moment(
                [frame.jacobian[:3].copy() for frame in frames],
                frames[0].mass.copy(),
                frames[0].bias.copy(),
                [2.0 * rng.normal(size=3) - frame.drift[:3] for frame in frames],
                rng.normal(size=n),
            )
        )
    return found + found[::-1]


def hierarchies(walk: list[Moment], tasks: int, seed: int | None = None) -> list[Problem]:
    """So many tasks along a walk, in strict order; with a seed at any priorities of (0, 1)."""
    upper, n = tasks - 1, len(walk[0].bias)
    alpha = np.tril(np.ones((tasks, tasks)), -1)
    if seed is not None:
        alpha = np.random.default_rng(seed).random((tasks, tasks))
    return [
        Problem(
            [3] * upper + [n],
            np.vstack([*each.jacobians[:upper], np.eye(n)]),
            np.concatenate([*each.wanted[:upper], each.posture]),
            alpha,
            each.mass,
            each.bias,
        )
        for each in walk
    ]


def bounds(it: Problem, qdd: Array, tau: Array) -> tuple[Array, Array]:
    """What |q̈| and |τ| may be at most, (n,), so that many bounds hold the free answer back.

    q̈ = 0 satisfies them, so that no problem is infeasible.
    """
    strain = STRAINED * np.abs(tau - it.bias).max()
    return np.full(qdd.size, HELD * np.abs(qdd).max()), np.abs(it.bias) + strain


def program(it: Problem, most: tuple[Array, Array] | None) -> Lqp:
    """(13) with |τ − n|² regularised and all its unknowns; `most` of q̈ and τ."""
    n, edges = it.bias.size, np.cumsum(it.sizes)[:-1]
    projectors = [generalized_projector(np.repeat(row, it.sizes), it.jacobian) for row in it.alpha]
    motion = np.hstack([*projectors, np.zeros((n, n))])
    H, f = W_R * np.eye(motion.shape[1]), np.zeros(motion.shape[1])
    parts = zip(np.split(it.jacobian, edges), np.split(it.targets, edges), strict=True)
    for i, (J, b) in enumerate(parts):
        own = slice(i * n, i * n + n)
        H[own, own] += J.T @ J
        f[own] = -J.T @ b
    f[-n:] = -W_R * it.bias
    rows, least, above = it.mass @ motion, -it.bias, -it.bias
    rows[:, -n:] = -np.eye(n)
    lower, upper = np.full(f.size, -NO_BOUND), np.full(f.size, NO_BOUND)
    if most is not None:
        rows = np.vstack([rows, motion])
        least, above = np.concatenate([least, -most[0]]), np.concatenate([above, most[0]])
        lower[-n:], upper[-n:] = -most[1], most[1]
    least, above = np.concatenate([lower, least]), np.concatenate([upper, above])
    sense = np.zeros(least.size, np.int32)
    sense[f.size : f.size + n] = EQUATION
    return Lqp(H, f, np.ascontiguousarray(rows), least, above, sense, motion)
