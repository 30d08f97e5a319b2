"""A margin that is a user's function of the posture."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.constraints.barrier import Barrier
from hoap3.remote_controller.constraints.dotted_path import load_function
from hoap3.remote_controller.model.kinematics import Kinematics


class UserFunction(Barrier):
    """m(q) ≥ 0 for a user's m: the function takes q, (n,) in wire order, and returns m and ∇m.

    These are (k,) and (k, n), always of one k. Where it returns something else, or something that
    is not finite, the rows are off, the margins −inf, so nothing is certified, and the event
    `bad_value` counts it. Parameters that speak of m or m/s mean the unit of m.
    """

    margin_unit = ""

    class Parameters(Barrier.Parameters):
        """The function."""

        function: str = Field(description="m and ∇m of q, as package.module:function")
        steepest: float | None = Field(
            None,
            gt=0,
            description="no joint changes m faster, no two bend it more [m/rad, m/rad²]; none: the "
            "reach of the robot",
        )

    def prepare(self, parameters: Parameters, kinematics: Kinematics) -> None:
        """Size the buffers."""
        super().prepare(parameters, kinematics)
        self._function = load_function(parameters.function, "function")
        self._q = np.array(self.description.initial_position)
        self.events["bad_value"] = 0
        found = self._values(None)
        if found is None:
            problem = "does not return m (k,) and ∇m (k, n), finite, in the initial posture"
            remedy = f"n is {self.n}; a single margin has k = 1"
            raise ConfigError("", "function", parameters.function, problem, remedy)
        self.name_rows(tuple(f"row {row}" for row in range(len(found[0]))))
        self._is_bad, self.reach = False, parameters.steepest or 0.0

    def look(self, kinematics: Kinematics, margins_out: FloatArray, A_out: FloatArray) -> None:
        """Write what the function says."""
        kinematics.joints(self._q)
        found = self._values(self.rows)
        self._is_bad = found is None
        if found is None:
            margins_out[:], A_out[:] = -math.inf, 0.0
        else:
            margins_out[:] = found[0]
            np.negative(found[1], out=A_out)

    def judge(self, kinematics: Kinematics) -> None:
        """Count a bad value."""
        self.events["bad_value"] += self._is_bad

    def _values(self, rows: int | None) -> tuple[FloatArray, FloatArray] | None:
        """M and ∇m of a posture; None where they are no such numbers."""
        found = self._function(self._q.copy())
        try:
            margins, gradients = found
            m, slopes = np.array(margins, np.float64), np.array(gradients, np.float64)
        except (TypeError, ValueError):
            return None
        fits = m.ndim == 1 and m.size > 0 and slopes.shape == (m.size, self.n)
        fits = fits and (rows is None or m.size == rows)
        return (m, slopes) if fits and np.isfinite(m).all() and np.isfinite(slopes).all() else None
