"""What `benchmarks.hierarchy` adds to Fig. 12 of the paper: iCub, bounds, and (13) as printed."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.solvers.ghc.projector_kernels import projector_kernel
from hoap3.remote_controller.solvers.qp.dense_qp import EQUATION, NO_BOUND, Program
from hoap3.robot_emulator.robots import load
from hoap3.robot_emulator.robots.urdf_import.imported import import_robot
from hoap3.tools.reproduce.papers.ghc import times
from hoap3.tools.reproduce.papers.ghc.times import W_R, Moment, Problem

Array = NDArray[np.float64]

FRAMES = times.FRAMES | {
    "icub": ("r_gripper", "l_gripper", "r_sole", "l_sole", "head", "chest"),
}
VENDORS = {"icub": ("example-robot-data", "icub_description/robots/icub.urdf")}
"""Robots whose own URDF is read from a package, where that is installed."""

HELD, STRAINED = 0.3, 0.2  # bounds, of the largest acceleration and effort that the tasks ask for


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


def moments(robot: str) -> list[Moment]:
    """The walk of a robot of `FRAMES`."""
    return times.moments(_described(robot), FRAMES[robot])


def bounds(it: Problem, qdd: Array, tau: Array) -> tuple[Array, Array]:
    """What |q̈| and |τ| may be at most, (n,), so that many bounds hold the free answer back.

    q̈ = 0 satisfies them, so that no problem is infeasible.
    """
    strain = STRAINED * np.abs(tau - it.bias).max()
    return np.full(qdd.size, HELD * np.abs(qdd).max()), np.abs(it.bias) + strain


@dataclass
class Lqp(Program):
    """(13), q̈ = motion·x; the last n of x are torques, with bounds of their own."""

    motion: Array


def program(it: Problem, most: tuple[Array, Array] | None) -> Lqp:
    """(13) with |τ − n|² regularised and all its unknowns; `most` of q̈ and τ."""
    n, edges = it.bias.size, np.cumsum(it.sizes)[:-1]
    projectors = np.empty((len(it.alpha), n, n))
    for row, P in zip(it.alpha, projectors, strict=True):
        projector_kernel(np.repeat(row, it.sizes), it.jacobian, 0.0, P)
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
