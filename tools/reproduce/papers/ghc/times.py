"""Fig. 12: how long a solution takes, over the number of tasks. Ours are measurements.

k tasks are the positions of k − 1 frames, strictly one below the other, and the posture below all,
along walks of two robots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.model.frame_dynamics import POSE, FrameRows, FramesDynamics
from hoap3.remote_controller.solvers import Ghc
from hoap3.robot_emulator.robots import load
from hoap3.tools.bench.case_runner import Case, time_cases
from hoap3.tools.reproduce.figures import COLOURS, Array, Axis, Curve, Figure, Panel, mark
from hoap3.tools.reproduce.rows import Row, row

FRAMES = {
    "lwr": ("ee", "elbow", "link_6", "link_3", "link_5", "link_2"),
    "humanoid32": ("r_palm", "l_palm", "r_sole", "l_sole", "head", "chest"),
}
ROBOTS = {"lwr": "7 joints", "humanoid32": "32 joints"}
OURS, NAME = "ghc", "GHC as here"
TASKS = (1, 2, 3, 4, 5, 6, 7)
HEADLINE = 5
PAPER_MS = {"lwr": 2.7, "humanoid32": 88.0}
"""Five tasks in the paper, with robots of as many joints, on the authors' machine."""

STATES = 32
W_R = 1e-2
SAMPLES = 200


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


def moments(description: RobotDescription, names: Sequence[str], seed: int = 0) -> list[Moment]:
    """A slow random walk of a robot from its initial posture, to and fro.

    Args:
        description: of the robot.
        names: frames whose Jacobians are wanted.
        seed: of the walk.
    """
    rng = np.random.default_rng(seed)
    n, count = description.n, len(names)
    frames = [FrameRows(name, POSE * i, POSE) for i, name in enumerate(names)]
    dynamics = FramesDynamics(description, frames, POSE * count)
    jacobians, drifts = dynamics.jacobian.reshape(count, POSE, n), dynamics.drift.reshape(-1, POSE)
    walk = np.cumsum(rng.normal(scale=0.03, size=(STATES // 2, n)), axis=0)
    q = np.array(description.initial_position) + rng.normal(scale=0.3, size=n) + walk
    dq = 0.3 * np.cumsum(rng.normal(scale=0.3, size=q.shape), axis=0)
    found = []
    for posture, speed in zip(q, dq, strict=True):
        dynamics.update(posture, speed)
        found.append(
            Moment(
                [each[:3].copy() for each in jacobians],
                dynamics.mass.copy(),
                dynamics.bias.copy(),
                [2.0 * rng.normal(size=3) - each[:3] for each in drifts],
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


def measure(samples: int = SAMPLES, tasks: tuple[int, ...] = TASKS) -> list[dict[str, Any]]:
    """Rows {robot, tasks, samples, min_us, …} of `Ghc`."""
    found = []
    for robot in ROBOTS:
        walk = moments(load(robot), FRAMES[robot])
        for k in tasks:
            taken = time_cases([_case(hierarchies(walk, k))], samples, batches=False)[OURS]
            found.append({"robot": robot, "tasks": k, **taken.figures()})
    return found


def _case(problems: list[Problem]) -> Case:
    solver = Ghc(problems[0].sizes, problems[0].bias.size)

    def solve(it: Problem) -> None:
        solver.solve(it.jacobian, it.targets, it.alpha, it.mass, it.bias, W_R)

    return Case(OURS, solve, [(it,) for it in problems])


def rows(timed: list[dict[str, Any]]) -> list[Row]:
    """Times of five tasks, and the trends."""
    ours = {(each["robot"], each["tasks"]): each for each in timed}
    least, most = min(tasks for _, tasks in ours), max(tasks for _, tasks in ours)
    made = []
    for robot, name in ROBOTS.items():
        item = f"Fig. 12: {name}, {HEADLINE} tasks, {NAME}, median"
        took = 1e-3 * ours[robot, HEADLINE]["p50_us"]
        made.append(row(item, PAPER_MS[robot], took, None, _TIME, "ms", timed=True))
        growth = ours[robot, most]["min_us"] / ours[robot, least]["min_us"]
        item = f"Fig. 12: {name}, {most} tasks / {least}"
        made.append(row(item, "increases", growth, (1.0, None), _TREND))
    sizes = ours["humanoid32", HEADLINE]["min_us"] / ours["lwr", HEADLINE]["min_us"]
    item = f"Fig. 12: {HEADLINE} tasks, 32 joints / 7 joints"
    return [*made, row(item, "increases", sizes, (1.0, None), _TREND)]


def draw(timed: list[dict[str, Any]]) -> Figure:
    """Medians over the number of tasks, and the paper's two means."""
    panels = []
    for robot, name in ROBOTS.items():
        picked = [each for each in timed if each["robot"] == robot]
        x = np.array([float(each["tasks"]) for each in picked])
        y = np.array([1e-3 * each["p50_us"] for each in picked])
        curves = [
            Curve(NAME, x, y, COLOURS[0], marker="o"),
            mark("the paper, mean", float(HEADLINE), PAPER_MS[robot], "X"),
        ]
        axis = Axis("time_ms", "time of one solution [ms]", log=True)
        panels.append(Panel(robot, name, Axis("tasks", "tasks [1]", step=1.0), axis, curves))
    title = "Fig. 12: absolute times are of other hardware, only the trends compare"
    return Figure("fig12", title, [panels], (12.0, 4.5))


_TIME = (
    "Other hardware, and another formulation: n unknowns in one compiled call; absolute times do "
    "not compare. `python -m benchmarks.hierarchy` has all of them, also with bounds"
)
_TREND = "As the paper: time grows with the tasks and with the joints; only the trend is judged"
