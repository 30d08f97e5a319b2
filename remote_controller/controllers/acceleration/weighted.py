"""The weighting strategy: a baseline of `ghc` that is never strict."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hoap3.protocol.errors import SolverError, located
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.acceleration.base import HierarchyController
from hoap3.remote_controller.controllers.acceleration.settings import RegularisedParameters
from hoap3.remote_controller.scheduling.weights import Weights, WeightSettings
from hoap3.remote_controller.solvers.ghc.weighted import weighted
from hoap3.remote_controller.tasks.registry import labels_of


class WeighedController(HierarchyController):
    """Tasks with weights beside each other."""

    importance: Weights

    @classmethod
    def importance_of(cls, parameters: Any) -> Weights:
        """The weights.

        Raises:
            ConfigError: they do not fit the tasks.
        """
        names = labels_of(parameters.tasks)
        with located("", "priorities"):
            return Weights(names, parameters.priorities)

    @classmethod
    def columns(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        """The weight of each task."""
        return tuple(f"weight_{name}" for name in names)

    def count(self, out: FloatArray) -> None:
        """Write the weights."""
        out[:] = self.importance.value
        np.greater(self.importance.value, 0.0, out=self.tops)
        np.logical_not(self.tops, out=self.absent)

    def judged(self) -> NDArray[np.bool_]:
        """Those of the greatest weight."""
        weights = self.importance.value
        return np.asarray((weights > 0.0) & (weights >= weights.max()))


class WeightedController(WeighedController):
    """(12) of Liu, Tan and Padois (2015): all tasks share one acceleration.

        min Σ ω_i |J_i ddq − b_i|² + ω_r |ddq + d·dq|² + ω_r |τ − o|²   within the bounds

    The paper has d = 0. A baseline: it allocates, and nothing of it is certified. V is that of all
    tasks with weight.
    """

    class Parameters(RegularisedParameters):
        """Tasks, bounds and weights."""

        regularise: Literal["gravity_compensated", "torque", "none"] = Field(
            "gravity_compensated", description="what ω_r weighs beside |ddq|², as for `ghc`"
        )
        priorities: WeightSettings = Field(
            WeightSettings(), description="weights of the tasks, in place of priorities"
        )

    def __init__(
        self, description: RobotDescription, parameters: Any, file: str = "config"
    ) -> None:
        super().__init__(description, parameters, file)
        self._regularise = parameters.regularise if parameters.base == "fixed" else "none"
        self.apply(parameters)

    def solve(self, torque_max: FloatArray) -> bool:
        """One quadratic program of all."""
        tasks, given = self.tasks, self.problem
        try:
            self.found[:], self.effort[:] = weighted(
                given.jacobian,
                given.wanted,
                tasks.sizes,
                self.importance.value,
                given.mass,
                given.bias,
                self.w_r,
                given.limits(torque_max),
                regularise=self._regularise,
                towards=given.towards,
            )
        except SolverError:
            return False
        return math.isfinite(float(self.effort.sum()))
