"""Greatest figures of joints: of the robot, of all, of single ones."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.constraints.constraint import Constraint


def least_limits(
    constraint: Constraint, robot: FloatArray, common: float | None, own: dict[str, float], key: str
) -> FloatArray:
    """The least of the robot's limits and those of a config, (n,).

    Args:
        constraint: which has the joints' names.
        robot: (n,) of the robot.
        common: of every joint; None: the robot's own.
        own: of single joints instead, by name, 0 and above.
        key: where `own` stands.

    Raises:
        ConfigError: no such joint, or a limit below 0.
    """
    wanted = np.full(constraint.n, common or np.inf)
    for name, joint in zip(own, constraint.joint_indices(key, own), strict=True):
        if own[name] < 0.0:
            where, remedy = f"{key}.{name}", "Write 0 or more"
            raise ConfigError("", where, own[name], "is negative", remedy)
        wanted[joint] = own[name]
    least: FloatArray = np.minimum(wanted, robot)
    return least
