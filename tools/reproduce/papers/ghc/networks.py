"""Section 2.1: priorities that are a network and no order, with `ghc_velocity` on HOAP-3."""

from __future__ import annotations

import numpy as np

from hoap3.robot_emulator.robots import load
from hoap3.tools.reproduce.papers.ghc.reference import NETWORK, WISHES, network_velocities
from hoap3.tools.reproduce.rows import Row, bounded
from hoap3.tools.simulate import simulate

EXACT = 1e-5  # of the regularisation, rad/s


def rows() -> list[Row]:
    """How far the first velocities are from the network's."""
    robot = load("hoap3")
    start = dict(zip(robot.joint_names, robot.initial_position.tolist(), strict=True))
    matrix, tasks = np.zeros((6, 6)), []
    for i, j in NETWORK:
        matrix[i - 1, j - 1] = 1.0
    for i, wanted in WISHES.items():
        place = {"joints": [*wanted], "target_rad": [start[each] + wanted[each] for each in wanted]}
        tasks.append({"name": f"t{i}", "task": "posture", "gain_per_s": 1.0, "parameters": place})
    free = {"bounds": {"acceleration_rad_s2": 1200.0}, "regularisation": 1e-6}
    given = {"tasks": tasks, "priorities": {"matrix": matrix.tolist()}, **free}
    done = simulate("hoap3", {"controller": "ghc_velocity", "parameters": given}, 0.01)
    u = (done.setpoints["values"][0] - done.states["reference"][0]) / robot.period_s
    expected = network_velocities()
    off = np.abs(u - [expected.get(name, 0.0) for name in robot.joint_names])
    item = "Section 2.1: network 1▷2▷3, 4▷5▷6, 2▷5, greatest error of a joint velocity"
    why = "As the paper: a task is kept out of those above it, and of no other"
    return [bounded(item, 0, off.max(), (None, EXACT), why, unit="rad/s")]
