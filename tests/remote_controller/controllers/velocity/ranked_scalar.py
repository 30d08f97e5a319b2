"""A Lyapunov function that is no square of an error, as a user may have one."""

from __future__ import annotations

import numpy as np

from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction


class Tilted(LyapunovFunction):
    """V = Σ (1 − cos q)."""

    def __init__(self, description, kinematics, parameters):
        super().__init__(description.n)
        self._q = np.zeros(description.n)

    def update(self, kinematics, time_s):
        kinematics.joints(self._q)
        self.value = float((1.0 - np.cos(self._q)).sum())
        np.sin(self._q, out=self.gradient)
