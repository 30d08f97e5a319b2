"""What tests of the page share: poses of a robot, and a config with live targets of a UR5."""

from __future__ import annotations

import numpy as np

import hoap3
from hoap3.protocol.robot.description import RobotDescription
from hoap3.tools.picture.poses import Poses

UR5 = hoap3.load_robot("ur5")
HAND = {"name": "hand", "dimension": 3, "rates": 3, "layout": ["x", "y", "z"], "unit": "m"}
BOUNDS = {"speed": [0.25] * 3, "acceleration": [1.0] * 3, "jerk": [20.0] * 3}


def posed(robot: RobotDescription, q: np.ndarray, base: np.ndarray | None = None) -> Poses:
    """Poses of the links of a robot at q, in wire order, and with this state of its base."""
    poses = Poses(robot)
    poses.update(q, base)
    return poses


def config_of(*tasks: object, **more: object) -> dict[str, object]:
    return {"controller": "any", "parameters": {"tasks": list(tasks), **more}}


def task(
    kind: str, frame: str = "tool0", target: str = "hand", **more: object
) -> dict[str, object]:
    """A task that follows a live target of that name."""
    steered = {"kind": "live", "name": target}
    return {"name": "it", "task": kind, "parameters": {"frame": frame, "target": steered, **more}}
