"""Where the robot is and how it moves: what rows of joint accelerations are made from."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.model.kinematics import Kinematics

ASIDE = 1e-5  # rad or m: how far the fastest joint is moved for a difference
AT_REST = 1e-9  # rad/s or m/s: what is slower has no J̇·dq worth the name


class Motion:
    """Kinematics at q, the velocities dq there, and kinematics at q ± ε·dq.

    Args:
        description, kinematics: of the robot; two more `Kinematics` are built.

    Attributes:
        kinematics: at q.
        q, dq: (n,) joint positions and velocities [rad, rad/s or m, m/s].
        moves: whether some joint does.
    """

    def __init__(self, description: RobotDescription, kinematics: Kinematics) -> None:
        self.kinematics = kinematics
        kinematics.load_drift()
        self.q, self.dq, self._shift, self._shifted = np.zeros((4, description.n))
        self.moves = False
        self._ahead, self._behind = Kinematics(description), Kinematics(description)
        for frame in description.frames:  # what is found in one is known to all
            for aside in (self._ahead, self._behind):
                aside.frame_id(frame)
        self._fresh, self._apart_s = False, 0.0

    def update(self, q: FloatArray, dq: FloatArray) -> None:
        """Take positions and velocities, (n,) both, finite."""
        self.q[:], self.dq[:] = q, dq
        self.kinematics.update(self.q)
        self._fresh = False
        self.moves = self._fastest() > AT_REST

    def aside(self) -> tuple[Kinematics, Kinematics, float]:
        """Kinematics at q + ε·dq and q − ε·dq, and 2ε [s]; made once a State, on demand.

        The fastest joint is 10 µrad off. For what is smooth a difference over 2ε misses a relative
        10⁻¹⁰ by its curvature, and as much by rounding.
        """
        if not self._fresh:
            epsilon = ASIDE / max(self._fastest(), AT_REST)
            np.multiply(self.dq, epsilon, out=self._shift)
            self._ahead.update(np.add(self.q, self._shift, out=self._shifted))
            self._behind.update(np.subtract(self.q, self._shift, out=self._shifted))
            self._fresh, self._apart_s = True, 2.0 * epsilon
        return self._ahead, self._behind, self._apart_s

    def frame_drift(self, frame: int, reference: int, out: FloatArray) -> None:
        """Write J̇·dq of a frame as `Kinematics.frame` sees it, (6,) [m/s² over rad/s²]."""
        self.kinematics.frame_drift(frame, reference, self.dq, out)

    def com_drift(self, frame: int, out: FloatArray) -> None:
        """Write J̇·dq of the centre of mass as `Kinematics.com` sees it, (3,) [m/s²]."""
        self.kinematics.com_drift(frame, self.dq, out)

    def _fastest(self) -> float:
        return float(max(self.dq.max(), -self.dq.min()))
