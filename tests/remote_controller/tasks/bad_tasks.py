"""Tasks with one fault each, which their derivatives near the initial posture do not show."""

from __future__ import annotations

import numpy as np
from own_tasks import Reach, Sway


class Faultless(Sway):
    """V = ½|q − a·sin(ωt)·1|²."""


class FarOff(Faultless):
    """Its gradient is wrong far from where it is checked."""

    def __init__(self, description, kinematics, parameters):
        super().__init__(description, kinematics, parameters)
        self.near = np.array(description.initial_position)

    def update(self, kinematics, time_s):
        super().update(kinematics, time_s)
        if np.abs(self.q - self.near).max() > 0.5:
            self.gradient[0] += 0.1


class Negative(Faultless):
    """V < 0, but late only."""

    def update(self, kinematics, time_s):
        super().update(kinematics, time_s)
        self.value -= 100.0 if time_s > 50.0 else 0.0


class Grudger(Faultless):
    """A reset does not make it forget."""

    worst = 0.0

    def update(self, kinematics, time_s):
        super().update(kinematics, time_s)
        self.worst = max(self.worst, self.value)
        self.value += 1e-9 * self.worst if 0.05 < time_s < 0.2 else 0.0


class Renewer(Faultless):
    """Makes its gradient anew at each update."""

    def update(self, kinematics, time_s):
        self.gradient = np.zeros(len(self.q))
        super().update(kinematics, time_s)


_shared = np.zeros(200)


class Sharer(Faultless):
    """All of its kind write into the same gradient."""

    def __init__(self, description, kinematics, parameters):
        super().__init__(description, kinematics, parameters)
        self.gradient = _shared[: description.n]


class Jumper(Faultless):
    """Stands still for the first ticks, then jumps to where it should be."""

    def update(self, kinematics, time_s):
        waits = time_s % 12.5 < 0.0305
        super().update(kinematics, 0.0 if waits else time_s)
        if waits:
            self.rate = 0.0


class Reaching(Reach):
    """e = |p|² − r(t)², and V from it."""


class Slanted(Reaching):
    """Its Jacobian is wrong later than it is checked; V and ∇V are not."""

    def update(self, kinematics, time_s):
        super().update(kinematics, time_s)
        if time_s > 1.8:
            self.jacobian[0, 0] += 1e-3


class Late(Reaching):
    """What it says of its target's motion is wrong, but late only."""

    def update(self, kinematics, time_s):
        super().update(kinematics, time_s)
        if time_s > 1.8:
            self.error_rate[0] *= 1.1
