"""What the paper prints, and (15) as an oracle of priorities.

The paper prints neither targets nor start nor the robot's inertia. Ours were fitted until the
errors that contradicting tasks leave were those of its Table 1, GHC.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HAND, ELBOW, POSTURE = TASKS = ("hand", "elbow", "posture")
"""Tasks 1, 2 and 3."""

PHASES = ("3 ▷ 2 ▷ 1", "1 ▷ 2 ▷ 3", "2 ▷ 1 ▷ 3", "1 ▷ 3", "1 ▷ 2 ▷ 3 again")
"""Hierarchies one after the other."""

HIGHEST = (POSTURE, HAND, ELBOW, HAND, HAND)
"""The task above all others, by phase."""

TABLE_1 = {
    "GHC": (
        ("0.46", "0.40", "2.2e-30"),
        ("1.0e-6", "0.46", "1.8"),
        ("0.42", "2.6e-6", "3.0"),
        ("3.9e-6", "0.55", "0.79"),
    ),
    "HQP": (
        ("0.46", "0.40", "2.8e-10"),
        ("4.5e-7", "0.46", "1.8"),
        ("0.42", "2.7e-6", "3.1"),
        ("4.5e-6", "0.55", "0.79"),
    ),
}
"""Printed errors of tasks 1, 2 and 3 by phase [m, m, rad]."""

HAND_M = (0.0783, -0.5129, 0.302)
ELBOW_M = (0.18689, 0.28125, 0.5249)
START = "table1"
"""Targets of hand and elbow, and the posture, where the arm also starts. Not in the paper."""

W_R = 0.01
STATIC, TRACKING = (30.0, 20.0), (100.0, 20.0)
"""kp [1/s²] and kd [1/s] for a target that stands, and for one that moves."""

SPEED_MAX, TORQUE_MAX = 1.2, 1.5
"""Bounds of Fig. 8 [rad/s, N m]."""

LEMNISCATE = (0.01, 1e-3, 1e-4)
"""ω_r for which the hand's error on its way round is shown."""

COMPROMISES = (0.0, 0.2, 0.5, 0.8, 1.0)
"""α₁₂ of Fig. 11, and its ends."""

WEIGHED = (100.0, 10.0, 1.0, 0.1, 0.01)
"""ω₁/ω₂ of the weighting strategy."""

FORCE_N = 10.0
"""Desired force of Figs. 9 and 10. Not in the paper, which shows a curve."""

PHASE_S = 8.0
"""How long each hierarchy lasts."""

ABOVE = (
    ((0, 1), (0, 2), (1, 2)),
    ((1, 0), (2, 0), (2, 1)),
    ((0, 1), (2, 0), (2, 1)),
    ((2, 0), (1, 0), (1, 1), (1, 2)),
    ((1, 0), (2, 0), (2, 1)),
)
"""Where α is 1, by phase: (i, j) says that task j stands above task i. In the fourth, task 2 takes
no part: it is kept out of everything, also of itself, and is in nobody's way."""


NETWORK = ((2, 1), (3, 1), (3, 2), (5, 4), (6, 4), (6, 5), (5, 2))
"""(i, j): task j stands above task i, in 1▷2▷3, 4▷5▷6 and 2▷5 of section 2.1."""

WISHES = {
    1: {"r_knee": 0.3, "l_knee": 0.1},
    2: {"r_knee": -0.2, "r_elbow": -0.1, "l_elbow": -0.2},
    3: {"l_knee": 0.2, "r_elbow": -0.3, "waist_pitch": 0.1},
    4: {"l_elbow": -0.1, "l_hip_roll": 0.1},
    5: {"l_hip_roll": -0.1, "r_elbow": -0.2, "l_shoulder_roll": 0.1},
    6: {"l_shoulder_roll": 0.2, "waist_pitch": 0.2, "l_elbow": -0.3},
}
"""Six tasks that contradict each other: the way that each wants joints to go [rad]."""


def network_velocities() -> dict[str, float]:
    """What joints do by the network at 1 1/s [rad/s].

    A joint moves as all tasks together want that no task above them keeps out of it.
    """
    found: dict[str, float] = {}
    for i, wanted in WISHES.items():
        above = {name for below, j in NETWORK if below == i for name in WISHES[j]}
        for name, way in wanted.items():
            found[name] = found.get(name, 0.0) + (0.0 if name in above else way)
    return found


def hierarchy(phase: int) -> Array:
    """The matrix of a phase, (3, 3)."""
    found = np.zeros((3, 3))
    for pair in ABOVE[phase]:
        found[pair] = 1.0
    return found


def expected(time_s: Array, over_s: float, phase_s: float = PHASE_S) -> Array:
    """The matrix by (15), without the code that the controller uses, (N, 3, 3)."""
    found = np.tile(hierarchy(0), (len(time_s), 1, 1))
    for phase in range(1, len(PHASES)):
        passed = np.clip((time_s - phase * phase_s) / over_s, 0.0, 1.0)
        share = 0.5 - 0.5 * np.cos(np.pi * passed)
        found += share[:, None, None] * (hierarchy(phase) - hierarchy(phase - 1))
    return found
