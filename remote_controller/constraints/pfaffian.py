"""Pfaffian constraints (QP12, section III-E, third case)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pydantic import Field

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import Constraint, PositionSource, positions
from hoap3.remote_controller.constraints.user_function import load_function
from hoap3.remote_controller.model.kinematics import Kinematics


class Pfaffian(Constraint):
    """C(q)·u = 0 with C from the config, or from a user's function of q.

    The function takes q, (n,) in wire order, and returns (k, n), always of one k. Where it
    returns something else, or something that is not finite, the last good matrix stays and the
    event `bad_matrix` counts it.
    """

    class Parameters(Constraint.Parameters):
        """Either `matrix` or `function`."""

        matrix: tuple[tuple[float, ...], ...] = Field(
            (), description="C, rows of n numbers; either this or function"
        )
        function: str | None = Field(None, description="C(q), as package.module:function")
        positions_from: PositionSource = Field("reference", description="the q that C is given")

    equality = True

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        self._source = parameters.positions_from
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
            found = _as_array(self._function(positions(state, self._source).copy()))
            if found is None or found.shape != A_out.shape or not np.isfinite(found).all():
                self.events["bad_matrix"] += 1
            else:
                self._matrix[:] = found
        A_out[:], b_out[:] = self._matrix, 0.0


def _as_array(found: object) -> FloatArray | None:
    """Numbers as an array; None where they are none, or ragged."""
    try:
        return np.array(found, dtype=np.float64)
    except (TypeError, ValueError):
        return None
