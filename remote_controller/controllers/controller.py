"""What every controller is: built from a description and its parameters, reset, stepped."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from protocol.description import RobotDescription
from protocol.messages import FloatArray, Setpoint, State, schema
from protocol.settings import Settings

STATUS = {
    name.removeprefix("STATUS_").lower(): value
    for name, value in schema("Setpoint").constants.items()
    if name.startswith("STATUS_")
}
"""Setpoint.solver_status by name: certified, at_target, uncertified, infeasible, none."""

ACTIVE_SPEED = 1e-3  # rad/s: below it a joint counts as inactive (QP12, section V-C)


class Controller(ABC):
    """Answers each State with a Setpoint.

    A subclass names its settings in a nested `Parameters` model and its additional log columns
    in `extra_names`, writes into `self.command` and returns it. Nothing may be allocated in
    `step` that can be allocated in `__init__`.

    Args:
        description: of the robot.
        parameters: a `Parameters` of this class.

    Attributes:
        command: the answer; its certificate says what was proved of it.
        now: clock of the loop [ns]; for stamps only, never for control.
    """

    class Parameters(Settings):
        """Settings of this controller; none here."""

    extra_names: ClassVar[tuple[str, ...]] = ()

    def __init__(self, description: RobotDescription, parameters: Settings) -> None:
        self.description, self.parameters = description, parameters
        self.now: Callable[[], int] = time.monotonic_ns
        self.command = Setpoint(description.n, len(self.extra_names))
        self.command.solver_status = STATUS["none"]

    @abstractmethod
    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Begin at `state`, so that the next command does not jump.

        Args:
            state: the newest one; its `reference` is what the robot applies.
            last_command: the last values sent to the robot, (n,), or None.
        """

    @abstractmethod
    def step(self, state: State) -> Setpoint:
        """Answer `state`; returns `self.command` with `values` and the certificate filled in."""


class VelocityController(Controller):
    """A controller that finds joint velocities u; setpoints are their Euler integral.

    q*_{k+1} = a_k + u_k·T, where a_k is the reference that the robot applies (footnote 11 of
    the QP12 paper has the measured position there; `integrate_from: measured` does that, and
    stalls on coarse encoders).
    """

    class Parameters(Controller.Parameters):
        """Settings that every velocity controller has."""

        integrate_from: str = "reference"

    def __init__(self, description: RobotDescription, parameters: Settings) -> None:
        super().__init__(description, parameters)
        self._dt = description.period_s
        self._from_measured = getattr(parameters, "integrate_from", "") == "measured"
        self._speed = np.zeros(description.n)

    @abstractmethod
    def velocity(self, state: State) -> FloatArray:
        """Joint velocities u for `state`, (n,) [rad/s or m/s], in wire order."""

    def reset(self, state: State, last_command: FloatArray | None) -> None:
        """Nothing to remember: every setpoint starts from the robot's applied reference."""

    def step(self, state: State) -> Setpoint:
        """Integrate `velocity` over one period."""
        command = self.command
        command.stamp_kinematics = self.now()
        u = self.velocity(state)
        values = command.values
        np.multiply(u, self._dt, out=values)
        values += state.q if self._from_measured else state.reference
        np.abs(u, out=self._speed)
        command.active_joints = int(np.count_nonzero(self._speed >= ACTIVE_SPEED))
        return command
