"""Robots of random shape in which some joints follow others, and some turn without end."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.robot.description import RobotDescription
from hoap3.robot_emulator.robots.yaml_file import RobotFile, describe
from support.robots.random_trees import inertial, placed, triple


def following_tree(seed: int, n: int, f: int, kind: str = "torque") -> RobotDescription:
    """A robot of n independent joints and f mimic joints, in any order along the tree.

    A mimic joint may stand before its mimicked joint, on another branch, and follow a mimic joint.
    """
    rng = np.random.default_rng(seed)
    parts, links = [f'<link name="root">{inertial(rng)}</link>'], ["root"]
    kinds = [str(rng.choice(("revolute", "continuous", "prismatic"))) for _ in range(n + f)]
    ranks = [
        int(rank) for rank in rng.permutation(n + f)
    ]  # a mimic joint's mimicked joint is below it
    for i, rank in enumerate(ranks):
        mimic = ""
        if rank >= n:
            mimicked = ranks.index(int(rng.integers(rank)))
            ratio, offset = rng.choice((-1.0, 1.0)) * rng.uniform(0.2, 2.0), rng.normal()
            mimic = f'<mimic joint="joint{mimicked}" multiplier="{ratio}" offset="{offset}"/>'
        bounds = "" if kinds[i] == "continuous" else 'lower="-90" upper="95" '
        rough = f'<dynamics damping="{rng.uniform()}" friction="{rng.uniform()}"/>'
        limit = f'<limit {bounds}velocity="{rng.uniform(0.5, 3.0)}" effort="60"/>'
        parts.append(
            f'<link name="link{i}">{inertial(rng)}</link>'
            f'<joint name="joint{i}" type="{kinds[i]}"><parent link="{rng.choice(links)}"/>'
            f'<child link="link{i}"/>{placed(rng, 0.3)}<axis xyz="{triple(rng.normal(size=3))}"/>'
            f"{limit}{mimic}{rough}</joint>"
        )
        links.append(f"link{i}")
    names = [f"joint{i}" for i, rank in enumerate(ranks) if rank < n]
    joints = [
        {"name": names[int(k)], "armature": float(rng.choice([0.0, 0.3]))}
        for k in rng.permutation(n)
    ]
    file = RobotFile(name="tree", urdf="tree.urdf", joints=joints, command_kinds=(kind,))
    return describe(file, f'<robot name="tree">{"".join(parts)}</robot>')


def state(robot: RobotDescription, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A random q and dq, (n,) each; q within the limits, and a turn or so where there are none."""
    rng = np.random.default_rng(seed)
    q = np.clip(rng.normal(size=robot.n) * 1.5, robot.lower, robot.upper)
    return q, rng.normal(size=robot.n)
