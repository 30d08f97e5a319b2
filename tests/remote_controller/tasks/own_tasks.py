"""Tasks and curves as users write them: right ones, and wrong ones to be caught."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from hoap3.protocol.config.settings import Settings
from hoap3.remote_controller.tasks.curve_following.curve import Curve
from hoap3.remote_controller.tasks.error_task import ErrorTask
from hoap3.remote_controller.tasks.lyapunov import LyapunovFunction


class Sway(LyapunovFunction):
    """V = ½|q − a·sin(ωt)·1|², by hand."""

    class Parameters(Settings):
        a_rad: float = Field(0.1, ge=0)
        fault: str = ""

    def __init__(self, description, kinematics, parameters):
        super().__init__(description.n)
        self.q, self.parameters = np.zeros(description.n), parameters

    def update(self, kinematics, time_s):
        a, fault = self.parameters.a_rad, self.parameters.fault
        kinematics.joints(self.q)
        away = self.q - a * math.sin(3.0 * time_s)
        self.value = 0.5 * float(away @ away)
        self.gradient[:] = away
        self.rate = -3.0 * a * math.cos(3.0 * time_s) * float(away.sum())
        if fault == "gradient":
            self.gradient[1] *= 1.01
        elif fault == "rate":
            self.rate = 0.0
        elif fault == "shape":
            self.gradient = np.zeros(2)
        elif fault == "nan":
            self.gradient[2] = math.nan
        elif fault == "negative":
            self.value -= 100.0
        elif fault == "raises":
            raise ZeroDivisionError("my own mistake")


class Reach(ErrorTask):
    """e = |p|² − r(t)², p the centre of mass as seen from the base, in m²."""

    class Parameters(Settings):
        r_m: float = 0.2
        fault: str = ""

    def __init__(self, description, kinematics, parameters):
        super().__init__(description.n, 1)
        self.parameters, self.base = parameters, kinematics.frame_id(description.base_frame)
        self.p, self.slope = np.zeros(3), np.zeros((3, description.n))

    def evaluate(self, kinematics, time_s):
        kinematics.com(self.base, self.p, self.slope)
        r, fault = self.parameters.r_m + 0.05 * math.sin(2.0 * time_s), self.parameters.fault
        self.error[0] = self.p @ self.p - r * r
        np.matmul(2.0 * self.p, self.slope, out=self.jacobian[0])
        self.error_rate[0] = -0.2 * r * math.cos(2.0 * time_s)
        if fault == "jacobian":
            self.jacobian[0, 1] *= 1.01
        elif fault == "error_rate":
            self.error_rate[0] = 0.0
        elif fault == "shape":
            self.jacobian = np.zeros((2, 2))
        elif fault == "nan":
            self.error_rate[0] = math.nan

    def update(self, kinematics, time_s):
        super().update(kinematics, time_s)
        if self.parameters.fault == "consistent":  # V is right, the error is another one
            self.jacobian[0, 2] += 0.3
        elif self.parameters.fault == "square":
            self.value, self.gradient, self.rate = 3 * self.value, 3 * self.gradient, 3 * self.rate


class NoUpdate(LyapunovFunction):
    """Forgets what it is for."""


class Tuned(Sway):
    """Reads changed numbers by the method of version 0.2."""

    def tune(self, parameters):
        self.parameters = parameters


class NotATask:
    """Something else."""


class Eight(Curve):
    """Gerono's lemniscate of the elbow and the wrist: x⁴ = r²(x² − y²), singular in its middle."""

    class Parameters(Settings):
        r: float = 0.4
        flips: bool = False
        wrong: bool = False

    def __init__(self, description, parameters):
        super().__init__(description.n)
        self.p, self.calls = parameters, 0
        self.center = np.array(description.initial_position)

    def evaluate(self, x):
        d, r = x - self.center, self.p.r
        self.alpha[:] = d[0], 0.5 * (d[1] ** 4 / r**3 - (d[1] ** 2 - d[2] ** 2) / r)
        self.gradients[:] = 0.0
        self.gradients[0, 0] = 1.0
        self.gradients[1, 1] = 2.0 * d[1] ** 3 / r**3 - d[1] / r
        self.gradients[1, 2] = d[2] / r * (1.1 if self.p.wrong else 1.0)
        self.calls += 1
        if self.p.flips and self.calls % 2:
            self.alpha[1] *= -1.0
            self.gradients[1] *= -1.0


class Helix(Curve):
    """An endless curve that twists, of three joints; no gradient ever vanishes."""

    def __init__(self, description, parameters):
        super().__init__(3)

    def evaluate(self, x):
        self.alpha[:] = x[0] - 0.2 * math.cos(5 * x[2]), x[1] - 0.2 * math.sin(5 * x[2])
        self.gradients[:] = [[1, 0, math.sin(5 * x[2])], [0, 1, -math.cos(5 * x[2])]]

    def pace(self, x):
        return 1.0 + 0.5 * math.sin(x[2])


class Flat(Curve):
    """Lies in another space than it should."""

    def __init__(self, description, parameters):
        super().__init__(2)

    def evaluate(self, x):
        self.alpha[0] = x[0]


class Turning(Curve):
    """A broken one: from one tick to the next its tangent is along another joint."""

    def __init__(self, description, parameters):
        super().__init__(3)
        self.axis = 0

    def evaluate(self, x):
        self.gradients[:] = np.delete(np.eye(3), self.axis, axis=0)
        self.alpha[:] = self.gradients @ x
