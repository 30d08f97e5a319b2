"""Plants as others might write them: one that is right, and a fault in each of the others."""

from __future__ import annotations

import random

import numpy as np

from hoap3.robot_emulator.plants.base import Plant


class Faultless(Plant):
    """Each joint goes half of the way that is left."""

    commands = ("position",)

    def __init__(self, description, parameters):
        super().__init__(description, parameters)
        self.target = self.q.copy()

    def reset(self, q):
        self.q[:] = self.start[:] = self.target[:] = q
        self.dq[:] = 0.0

    def step(self, command, dt):
        self.target[:] = command
        self.hold(dt)

    def hold(self, dt):
        self.dq[:] = 0.5 * (self.target - self.q) / dt
        self.q += dt * self.dq


class Renewer(Faultless):
    def step(self, command, dt):
        super().step(command, dt)
        self.q = self.q.copy()


class Sharer(Faultless):
    places = np.zeros(6)

    def __init__(self, description, parameters):
        super().__init__(description, parameters)
        self.q = self.places


class Drifter(Faultless):
    def reset(self, q):
        self.q[:] = self.start[:] = self.target[:] = q


class Keeper(Faultless):
    def step(self, command, dt):
        self.target = command
        self.hold(dt)


class Meddler(Faultless):
    def step(self, command, dt):
        super().step(command, dt)
        command += 1e-3


class Grower(Faultless):
    def hold(self, dt):
        super().hold(dt)
        self.tau[:] = 10.0 * self.tau + 1.0


class Gambler(Faultless):
    def hold(self, dt):
        super().hold(dt)
        self.q += 1e-6 * random.random()


class Grudger(Faultless):
    def __init__(self, description, parameters):
        super().__init__(description, parameters)
        self.warmth = 0.0

    def hold(self, dt):
        super().hold(dt)
        self.warmth += dt
        self.tau[:] = self.warmth
