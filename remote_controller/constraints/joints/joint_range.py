"""The part of joints' ranges that is used, and how far inside it they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.constraints.constraint import Constraint


class JointRange:
    """Usable ranges of some joints less a margin; gives a constraint two margins a joint.

    Args:
        constraint: of a robot; its `margins`, `margin_names` and `margin_units` are set.
        margin_rad: taken off both ends [rad or m].
        joints: names of those that are kept.

    Attributes:
        least, greatest: (n,) [rad or m]; ∓inf of others.

    Raises:
        ConfigError: no such joint, or nothing is left of a range.
    """

    def __init__(self, constraint: Constraint, margin_rad: float, joints: Sequence[str]) -> None:
        robot, n = constraint.description, constraint.n
        kept = constraint.joint_indices("joints", joints)
        self.least, self.greatest = np.full(n, -np.inf), np.full(n, np.inf)
        self.least[kept] = robot.lower[kept] + margin_rad
        self.greatest[kept] = robot.upper[kept] - margin_rad
        for joint in kept:
            if self.least[joint] > self.greatest[joint]:
                width = float(robot.upper[joint] - robot.lower[joint])
                problem = f"leaves nothing of the range of joint {robot.joint_names[joint]!r}"
                raise ConfigError("", "margin_rad", margin_rad, problem, f"At most {width / 2}")
        constraint.least, constraint.greatest = self.least, self.greatest
        self._margins = constraint.margins = np.full(2 * n, np.inf)
        constraint.margin_units = 2 * robot.joint_units
        constraint.margin_names = tuple(
            f"{name} {end}" for end in ("lower", "upper") for name in robot.joint_names
        )

    def measure(self, q: FloatArray) -> float:
        """Write the margins of positions (n,); return the smallest."""
        n = q.size
        np.subtract(q, self.least, out=self._margins[:n])
        np.subtract(self.greatest, q, out=self._margins[n:])
        return float(self._margins.min())
