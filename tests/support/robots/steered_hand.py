"""How well UR5's hand follows a curve that somebody steers it along."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import hoap3
from hoap3.remote_controller.model.kinematics import Kinematics

MOVING = slice(3000, -700)  # ticks: after the way to the curve, and before the end
T = 1e-3


def hands(postures: np.ndarray) -> np.ndarray:
    """Where UR5's hand is in each posture, (ticks, 3) [m]."""
    robot = hoap3.load_robot("ur5")
    kinematics = Kinematics(robot)
    frames = kinematics.frame_id("tool0"), kinematics.frame_id(robot.base_frame)
    place, turn, jacobian = np.zeros(3), np.zeros((3, 3)), np.zeros((6, 6))
    found = np.zeros((len(postures), 3))
    for row, q in enumerate(postures):
        kinematics.update(q)
        kinematics.frame(*frames, place, turn, jacobian)
        found[row] = place
    return found


def lag_and_error(
    path: np.ndarray, ticks: np.ndarray, place: Callable[[np.ndarray], np.ndarray]
) -> tuple[int, float]:
    """The delay [ticks] that explains a path best, and the RMS error that is left [m]."""
    errors = {
        lag: float(np.sqrt(((path - place(ticks - lag))[MOVING] ** 2).sum(1).mean()))
        for lag in range(-50, 51)
    }
    lag = min(errors, key=errors.__getitem__)
    return lag, errors[lag]


def peak_jerk(path: np.ndarray, ticks: np.ndarray) -> float:
    """Greatest third difference over T³ of any axis [m/s³], where no tick is missing."""
    whole = ticks[3:] - ticks[:-3] == 3
    return float(np.abs(np.diff(path, 3, axis=0)[whole]).max() / T**3)
