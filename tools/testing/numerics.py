"""Random postures, and derivatives by differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription

STEP = 1e-5  # rad, m or s


def posture(robot: RobotDescription, seed: int) -> FloatArray:
    """Joint positions anywhere in the usable ranges, (n,)."""
    return np.random.default_rng(seed).uniform(*robot.sampling_range)


def quotient(function: Callable[[FloatArray], FloatArray], at: FloatArray) -> FloatArray:
    """Derivative by central differences; one column for each component of `at`."""
    columns = [
        (function(at + shift) - function(at - shift)) / (2 * STEP)
        for shift in STEP * np.eye(len(at))
    ]
    return np.stack(columns, axis=-1)
