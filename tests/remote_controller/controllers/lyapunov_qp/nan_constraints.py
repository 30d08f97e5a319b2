"""Constraints that go wrong in the midst of a motion."""

from __future__ import annotations

import numpy as np

from hoap3.remote_controller.constraints.constraint import Constraint


class Clouded(Constraint):
    """A row that is no number between two ticks."""

    def __init__(self, *given):
        super().__init__(*given)
        self.rows, self.names = 1, ("cloud",)

    def update(self, kinematics, state, A_out, b_out):
        A_out[0], b_out[0] = 0.0, np.inf
        if 100 <= state.tick < 300:
            A_out[0], b_out[0] = np.nan, 0.0


class Blurred(Constraint):
    """Bounds that are no numbers between two ticks."""

    def bounds(self, state, lower_out, upper_out):
        if 100 <= state.tick < 300:
            lower_out[:], upper_out[:] = np.nan, np.nan
