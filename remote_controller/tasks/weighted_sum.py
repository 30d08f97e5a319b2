"""Several Lyapunov functions at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from pydantic import Field

from hoap3.protocol.config.settings import Settings
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.tasks import status
from hoap3.remote_controller.tasks.accuracy import TaskError, name_errors
from hoap3.remote_controller.tasks.lyapunov import BuildContext, LyapunovFunction
from hoap3.remote_controller.tasks.registry import TaskSettings, build


class TermSettings(TaskSettings):
    """A task of the sum."""

    weight: float = Field(1.0, gt=0, description="w of w·V")


class WeightedSum(LyapunovFunction):
    """V = Σ w_i·V_i: a trade-off; each term is judged on its own, by its own tolerance.

    V vanishes only where all terms do. Where they contradict each other V has a minimum above 0,
    at which the robot stops.

    Args:
        terms: any Lyapunov functions of the same robot.
        weights: w_i > 0, one for each.
        names: of the terms, in verdicts; by default their numbers.
    """

    class Parameters(Settings):
        """The terms."""

        terms: tuple[TermSettings, ...] = Field(
            min_length=1, description="tasks, each with its weight"
        )

    def __init__(
        self,
        terms: Sequence[LyapunovFunction],
        weights: Sequence[float],
        names: Sequence[str] = (),
    ) -> None:
        n = len(terms[0].gradient)
        sizes = [len(term.error) for term in terms]
        super().__init__(n, sum(sizes) if all(sizes) else 0)
        ends = np.cumsum(sizes)
        self._terms = [
            (
                term,
                weight,
                math.sqrt(weight),
                self.error[end - size : end],
                self.jacobian[end - size : end],
                self.error_rate[end - size : end],
            )
            for term, weight, size, end in zip(terms, weights, sizes, ends, strict=True)
        ]
        self._scaled = np.zeros(n)
        self._names = names or [f"term {number + 1}" for number in range(len(terms))]
        self.watched = any(term.watched for term in terms)

    def without_error(self) -> str | None:
        """That of the first such term."""
        for number, (term, *_) in enumerate(self._terms):
            if key := term.without_error():
                return f"parameters.terms.{number}.{key}"
        return None

    @classmethod
    def configured(cls, context: BuildContext, parameters: Any) -> Self:
        """The sum of its terms, each built for the robot at `context`."""
        terms = [
            build(
                term,
                context.description,
                context.kinematics,
                context.file,
                f"{context.key}.terms.{number}",
                context.level,
            )
            for number, term in enumerate(parameters.terms)
        ]
        names = [f"{number}. {term.task}" for number, term in enumerate(parameters.terms, 1)]
        return cls(terms, [term.weight for term in parameters.terms], names)

    def reset(self, kinematics: Kinematics, time_s: float) -> None:
        """Reset each term."""
        for term, *_ in self._terms:
            term.reset(kinematics, time_s)

    def watch(self, kinematics: Kinematics, tick: int, time_s: float) -> bool:
        """Watch each term; whether a tolerance of any is, or was, violated."""
        return max(term.watch(kinematics, tick, time_s) for term, *_ in self._terms)

    def update(self, kinematics: Kinematics, time_s: float) -> None:
        """Recompute V, ∇V and ∂V/∂t; the status is that of the first term that has one to tell."""
        self.value, self.rate, self.status = 0.0, 0.0, status.OK
        self.gradient[:] = 0.0
        for term, weight, root, error, jacobian, error_rate in self._terms:
            term.update(kinematics, time_s)
            self.value += weight * term.value
            self.rate += weight * term.rate
            np.multiply(term.gradient, weight, out=self._scaled)
            np.add(self.gradient, self._scaled, out=self.gradient)
            if len(self.error):
                np.multiply(term.error, root, out=error)
                np.multiply(term.jacobian, root, out=jacobian)
                np.multiply(term.error_rate, root, out=error_rate)
            self.status = self.status or term.status

    def accuracy(self) -> list[TaskError]:
        """Errors of all terms, each judged: where they contradict each other, one fails."""
        return [
            error
            for name, (term, *_) in zip(self._names, self._terms, strict=True)
            for error in name_errors(term.accuracy(), name)
        ]
