"""The UR5 as the paper has it, and its two tasks: the hand's place, and y of the wrist.

The toolbox that the paper names has the arm in the standard convention of Denavit and Hartenberg,
and the code of its authors takes frame {4} of it for the fourth joint. The paper's start and
targets fit that, and do not fit a base that is turned by 180°, as that of ROS.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from hoap3.tools.reproduce.figures import Array

Tasks = Callable[[Array], tuple[Array, Array]]
"""Stacked Jacobian (n, joints) and errors σ* − σ (n,) at joint positions (joints,) [rad]."""

A = (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)
D = (0.089459, 0.0, 0.0, 0.10915, 0.09465, 0.0823)
ALPHA = np.radians([90.0, 0.0, 0.0, 90.0, -90.0, 0.0])
JOINTS = len(A)
SIZES = (3, 1)
START = np.radians([135.0, 0.0, -90.0, 0.0, 90.0, 0.0])
HAND_M, WRIST_Y_M = np.array([-0.5, -0.4, 0.6]), -0.3


def toolbox(wrist: Literal[3, 4] = 4, *, turned: bool = False) -> Tasks:
    """The tasks of the paper.

    Args:
        wrist: number of the frame whose origin is the wrist.
        turned: whether the base is turned by 180° about z.
    """
    sign = np.array([-1.0, -1.0, 1.0]) if turned else np.ones(3)

    def tasks(q: Array) -> tuple[Array, Array]:
        axes, origins = frames(q)
        axes, origins = axes * sign, origins * sign  # both turn like places
        J = np.zeros((4, JOINTS))
        J[:3] = np.cross(axes[:-1], origins[-1] - origins[:-1]).T
        J[3, :wrist] = np.cross(axes[:wrist], origins[wrist] - origins[:wrist])[:, 1]
        return J, np.array([*(HAND_M - origins[-1]), WRIST_Y_M - origins[wrist, 1]])

    return tasks


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
