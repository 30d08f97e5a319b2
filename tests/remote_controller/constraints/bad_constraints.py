"""Constraints with one fault each."""

from __future__ import annotations

import numpy as np

from hoap3.remote_controller.constraints.barrier import Barrier
from hoap3.remote_controller.constraints.constraint import Constraint


class Faultless(Barrier):
    """The sum of all joints stays below 1 more than at the initial posture."""

    sign = -1.0

    def __init__(self, parameters, description, kinematics, period_s):
        super().__init__(parameters, description, kinematics, period_s)
        self.name_rows(("sum",))
        self.most = float(np.sum(description.initial_position)) + 1.0

    def update(self, kinematics, state, A_out, b_out):
        self.margins[0] = self.most - state.reference.sum()
        A_out[0] = -self.sign
        self.limit(A_out, b_out)


class Backward(Faultless):
    """Its row allows what it should forbid."""

    sign = 1.0


class Hasty(Faultless):
    """Comes nearer faster than (25) has it."""

    def update(self, kinematics, state, A_out, b_out):
        super().update(kinematics, state, A_out, b_out)
        b_out += 0.5


class Grudger(Faultless):
    """A reset does not make it forget."""

    calls = 0

    def update(self, kinematics, state, A_out, b_out):
        self.calls += 1
        super().update(kinematics, state, A_out, b_out)
        b_out += 1e-12 * self.calls


class Adder(Faultless):
    """Leaves in its arrays what was there before."""

    def update(self, kinematics, state, A_out, b_out):
        before = A_out[0, 0]
        super().update(kinematics, state, A_out, b_out)
        A_out[0, 0] = before


class Forbidder(Faultless):
    """Switches its row off in a way that no u can satisfy."""

    def update(self, kinematics, state, A_out, b_out):
        super().update(kinematics, state, A_out, b_out)
        if self.margins[0] < 0.0:
            A_out[:], b_out[:] = 0.0, -1.0


class Widener(Constraint):
    """Gives bounds of its own, whatever the others say."""

    def bounds(self, state, lower_out, upper_out):
        lower_out[:], upper_out[:] = -9.0, 9.0


class Renewer(Faultless):
    """Makes its margins anew at each update."""

    def update(self, kinematics, state, A_out, b_out):
        self.margins = np.zeros(1)
        super().update(kinematics, state, A_out, b_out)


class Meddler(Faultless):
    """Writes into the State."""

    def update(self, kinematics, state, A_out, b_out):
        super().update(kinematics, state, A_out, b_out)
        state.dq[0] += 1.0
