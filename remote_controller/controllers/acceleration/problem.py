"""What the solvers of several tasks are given, what became of it, and what may hold in a cycle."""

from __future__ import annotations

from typing import NamedTuple

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.solvers.ghc.row_equations import Limits

SOLVED, NEAREST, OVERLOADED_MOTORS, GAVE_UP, STOPPED = range(5)  # Setpoint.fallback
CONDITIONS = (
    "state not finite",
    "tasks have no answer within bounds",
    "torques too small",
    "QP not solved",
    "held by bounds of joints",
    "half a turn from the goal",
    "cannot hold its load",
    "priorities in transition",
    "touches",
    "no task takes part",
    "its solver proves nothing",
    "answer not finite",
    "stops for a constraint",
)
BITS = [1 << bit for bit in range(len(CONDITIONS))]
NOT_FINITE, UNFIT, TOO_SMALL, UNSOLVED, HELD, HALF_A_TURN = BITS[:6]
LOADED, MOVING, TOUCHES, IDLE, UNPROVED, OVERFLOWN, STOPS = BITS[6:]
WHY = [0, UNFIT, UNFIT | TOO_SMALL, UNFIT | UNSOLVED, UNFIT]
"""By what became of the tasks' problem, in the order of `fallback`."""


class Problem(NamedTuple):
    """Tasks J·x → b within bounds, with x, (n,), the unknown.

    Of a robot that is fixed to the ground x is ddq; of one with a free base it is what contacts
    leave (`solvers.contact.reduction`), and limits of joints and torques are rows.

    Attributes:
        jacobian, wanted: of the tasks, J (m, n) and b (m,).
        with_rest: the same, and below it the rows that brake, n of them.
        towards: what x shall be where nothing else counts, (n,).
        mass, bias: τ = M·x + h, (n, n) and (n,).
        lower, upper: of x, (n,).
        rows, rows_lower, rows_upper: lower ≤ G·x ≤ upper, (s, n) and (s,).
    """

    jacobian: FloatArray
    wanted: FloatArray
    with_rest: tuple[FloatArray, FloatArray]
    towards: FloatArray
    mass: FloatArray
    bias: FloatArray
    lower: FloatArray
    upper: FloatArray
    rows: FloatArray
    rows_lower: FloatArray
    rows_upper: FloatArray

    def limits(self, torque_max: FloatArray) -> Limits:
        """All limits of an answer, with |τ| ≤ torque_max, (n,)."""
        rows = self.rows, self.rows_lower, self.rows_upper
        return Limits(self.lower, self.upper, -torque_max, torque_max, *rows)
