"""Problems of gains along motions of shipped robots, one a tick, in the order of the motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import UnknownNameError
from hoap3.protocol.messages import State
from hoap3.remote_controller.solvers.sdp.sdp_gains import SdpGains
from hoap3.tools.bench.cycle import motion

Array = NDArray[np.float64]

MOTIONS: dict[str, tuple[Any, str]] = {
    "ur5": ({"robot": "ur5", "posture": "outstretched"}, "clik_sdp_ur5"),
    "hoap3": ("hoap3", "clik_sdp_hoap3"),
    "humanoid32": ("humanoid32", "clik_sdp_humanoid"),
}
"""Settings of emulator and controller."""


class Moment(NamedTuple):
    """What changes from tick to tick: Jacobians and errors, stacked, and limits of dq."""

    jacobian: Array
    errors: Array
    lower: Array
    upper: Array


@dataclass(frozen=True)
class Walk:
    """A motion, tick by tick, as the solver of a controller meets it.

    Attributes:
        law: the controller `clik_sdp`, after its reset.
        states: of the motion.
        moments: of the same ticks.
        dt, desired, delta: Δt [s], β̃ [1/s], δ.
    """

    robot: str
    law: Any
    states: list[State]
    moments: list[Moment]
    dt: float
    desired: float
    delta: float

    def solver(self, kind: Callable[..., SdpGains] = SdpGains, **options: Any) -> SdpGains:
        """A solver for it, with the weights of the controller's tasks."""
        own = self.law.solver
        solver = kind(self.law.sizes, own.joints, **options)
        solver.weights[:] = own.weights
        return solver

    def call(self, solver: SdpGains) -> Callable[[Array, Array, Array, Array], SdpGains]:
        """A function of what a `Moment` has, which solves its problem, limits included."""
        solve, lower, upper = solver.solve, solver.lower, solver.upper
        dt, desired, delta = self.dt, self.desired, self.delta

        def call(jacobian: Array, errors: Array, least: Array, most: Array) -> SdpGains:
            lower[:], upper[:] = least, most
            solve(jacobian, errors, dt, desired, delta)
            return solver

        return call


def walk(robot: str, duration: float) -> Walk:
    """Record a motion of `duration` [s] from the initial posture.

    Raises:
        UnknownNameError: there is none of this robot.
    """
    if robot not in MOTIONS:
        raise UnknownNameError("robot", robot, MOTIONS)
    law, states = motion(*MOTIONS[robot], duration, every=True)
    solve, moments = law.solve, []

    def recorded() -> Any:
        own = law.solver
        arrays = law.jacobian, law.errors, own.lower, own.upper
        moments.append(Moment(*(each.copy() for each in arrays)))
        return solve()

    law.solve = recorded
    for state in states:
        law.step(state)
    law.solve = solve
    law.reset(states[0], None)
    given = law.parameters
    period = law.description.period_s
    return Walk(robot, law, states, moments, period, given.beta_per_s, given.delta)
