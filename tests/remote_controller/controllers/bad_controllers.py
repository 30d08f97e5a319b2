"""Third-party controllers, each with one fault, and one without: does the property suite notice?"""

from __future__ import annotations

import numba
import numpy as np

from hoap3.protocol.messages import Setpoint
from hoap3.remote_controller.controllers.qp12.qp12 import Qp12Controller

SHARED = Setpoint(21)


class Faultless(Qp12Controller):
    """Nothing to find."""


class Hasty(Qp12Controller):
    def velocity(self, state):
        return super().velocity(state) * 100.0


class Jumper(Qp12Controller):
    """Goes on from what it sent last, wherever the robot is."""

    def reset(self, state, last_command):
        self.kept = state.reference.copy() if last_command is None else last_command.copy()

    def step(self, state):
        self.kept += self.velocity(state) * self._dt
        self.command.values[:] = self.kept
        return self.command


class Restless(Qp12Controller):
    """Turns around at every reset."""

    def velocity(self, state):
        u = super().velocity(state)
        u[5] = 4.0 if state.tick % 2 else -4.0
        return u


class Gambler(Qp12Controller):
    def velocity(self, state):
        return super().velocity(state) * np.random.default_rng().uniform(0.5, 1.0)


class Clockwatcher(Qp12Controller):
    def velocity(self, state):
        return super().velocity(state) * (1.0 if self.now() % 2 else 0.9)


class Grudger(Qp12Controller):
    """Remembers over a reset."""

    steps = 0

    def velocity(self, state):
        self.steps += 1
        return super().velocity(state) / (1.0 + 1e-3 * self.steps)


class Liar(Qp12Controller):
    def velocity(self, state):
        u = super().velocity(state)
        self.command.v_rate_predicted *= 1.1
        return u


class Sluggard(Qp12Controller):
    """Certifies less than it requires."""

    def velocity(self, state):
        u = super().velocity(state)
        u *= 0.5
        self.command.v_rate_predicted *= 0.5
        return u


class Hoarder(Qp12Controller):
    def __init__(self, description, parameters):
        super().__init__(description, parameters)
        self.errors = []

    def velocity(self, state):
        u = super().velocity(state)
        self.errors.append(self.task.error.copy())
        return u


class Latecomer(Qp12Controller):
    """Compiles when it first needs to: not in the rehearsal."""

    steps = 0

    def velocity(self, state):
        self.steps += 1
        if self.steps == 250:
            numba.njit(lambda x: x + self.steps)(1.0)
        return super().velocity(state)


class Meddler(Qp12Controller):
    def velocity(self, state):
        u = super().velocity(state)
        state.dq[:] = u
        return u


class Sharer(Qp12Controller):
    """Two of a kind answer with one command."""

    def __init__(self, description, parameters):
        super().__init__(description, parameters)
        self.command = SHARED


class Numberer(Qp12Controller):
    """Knows joints by their number."""

    def velocity(self, state):
        u = super().velocity(state)
        u[7] += 1e-3
        return u
