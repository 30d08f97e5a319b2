"""Pfaffian constraints (QP12, section III-E, third case)."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
from pydantic import Field

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import (
    Constraint,
    Guarantee,
    Level,
    PositionSource,
    positions,
)
from hoap3.remote_controller.constraints.dotted_path import load_function
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.model.motion import Motion


class Pfaffian(Constraint):
    """C(q)·u = 0 with C from the config, or from a user's function of q.

    The function takes q, (n,) in wire order, and returns (k, n), always of one k. Where it
    returns something else, or something that is not finite, the last good matrix stays and the
    event `bad_matrix` counts it.

    For accelerations C·q̈ = −Ċ·q̇ − η·C·q̇, and `drift` is the largest |C·q̇|, which one period
    leaves within c·T²/2 of (1 − ηT) times what it was, c ≥ |d²(C·q̇)/dt²| at that q̈. From 0 it
    stays within c·T/(2η), but where the robot stops for another constraint.
    """

    class Parameters(Constraint.Parameters):
        """Either `matrix` or `function`."""

        matrix: tuple[tuple[float, ...], ...] = Field(
            (), description="C, rows of n numbers; either this or function"
        )
        function: str | None = Field(None, description="C(q), as package.module:function")
        positions_from: PositionSource = Field(
            "reference", description="the q that C is given; for accelerations it is measured"
        )
        eta_per_s: float = Field(
            10.0,
            ge=0,
            description="for accelerations: rate at which C·q̇ goes to 0, at most 1/period [1/s]",
        )

    equality = True
    levels: ClassVar[tuple[Level, ...]] = ("velocity", "acceleration")
    guarantee: ClassVar[Guarantee] = "bounded drift"

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        self._source, self._eta = parameters.positions_from, self.rate_of(parameters)
        self._drift = 0.0
        self._function: Callable[[FloatArray], object] | None = None
        if bool(parameters.matrix) == (parameters.function is not None):
            remedy = "Write exactly one of matrix and function"
            raise ConfigError("", "matrix", None, "gives no single C", remedy)
        if parameters.function is None:
            key, found = "matrix", _as_array(parameters.matrix)
        else:
            self._function = load_function(parameters.function, "function")
            key, found = (
                "function",
                _as_array(self._function(self.description.initial_position.copy())),
            )
        if found is None or found.ndim != 2 or found.shape[1] != self.n or not len(found):
            shape = "no numbers" if found is None else f"shape {found.shape}"
            remedy = f"Give k rows of {self.n} numbers"
            raise ConfigError("", key, parameters.function, f"gives {shape}", remedy)
        if not np.isfinite(found).all():
            problem, remedy = "is not finite in the initial posture", "Give finite numbers"
            raise ConfigError("", key, parameters.function, problem, remedy)
        self._matrix = np.array(found)
        self.rows = len(found)
        self.names = tuple(f"row {row}" for row in range(self.rows))
        self.events["bad_matrix"] = 0

    def update(
        self, kinematics: Kinematics, state: State, A_out: FloatArray, b_out: FloatArray
    ) -> None:
        """Write C(q)·u = 0."""
        if self._function is not None:
            self._take(positions(state, self._source))
        A_out[:], b_out[:] = self._matrix, 0.0

    def prepare_accelerations(self, speed: FloatArray, deceleration: FloatArray) -> None:
        """Size the buffers."""
        self._q = np.zeros(self.n)

    def update_accelerations(
        self,
        motion: Motion,
        state: State,
        G_out: FloatArray,
        lower_out: FloatArray,
        upper_out: FloatArray,
    ) -> None:
        """Write C·q̈ = −Ċ·q̇ − η·C·q̇."""
        if self._function is not None:
            self._take(motion.q)
        G_out[:] = self._matrix
        np.dot(self._matrix, motion.dq, out=upper_out)
        self._drift = float(np.abs(upper_out).max())
        upper_out *= -self._eta
        if self._function is not None and motion.moves:
            self._differ(motion, upper_out)
        lower_out[:] = upper_out

    def drift(self) -> float:
        """Largest |C·q̇| of the last update for accelerations."""
        return self._drift

    def _take(self, q: FloatArray) -> None:
        """Have C be that of a posture, if it is good."""
        found = self._found(q)
        if found is None:
            self.events["bad_matrix"] += 1
        else:
            self._matrix[:] = found

    def _differ(self, motion: Motion, out: FloatArray) -> None:
        """Take off Ċ·q̇; where C is bad nearby it counts as constant."""
        sides = motion.aside()
        matrices = []
        for kinematics in sides[:2]:
            kinematics.joints(self._q)
            matrices.append(self._found(self._q))
        ahead, behind = matrices
        if ahead is not None and behind is not None:
            out -= (ahead - behind) @ motion.dq / sides[2]

    def _found(self, q: FloatArray) -> FloatArray | None:
        """What the function says of a posture, (k, n); None where it is no such matrix."""
        if self._function is None:
            return self._matrix
        found = _as_array(self._function(q.copy()))
        if found is None or found.shape != self._matrix.shape or not np.isfinite(found).all():
            return None
        return found


def _as_array(found: object) -> FloatArray | None:
    """Numbers as an array; None where they are none, or ragged."""
    try:
        return np.array(found, dtype=np.float64)
    except (TypeError, ValueError):
        return None
