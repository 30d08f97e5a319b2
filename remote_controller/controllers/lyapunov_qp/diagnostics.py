"""What people should know of a cycle of `stable_qp`, as bits for the log."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.constraints.stack import ConstraintStack, EventConditions
from hoap3.remote_controller.controllers.base import bits
from hoap3.remote_controller.solvers.base import status as solver_status
from hoap3.remote_controller.tasks import status as task_status

BELOW_ONE = 1.0 - 1e-6  # of ρ: the constraints slow the fall of V
ACTIVE = 1e-6  # of a row: its slack, relative to its length [rad/s]
BOUNDS = "held by bounds of joints"


class Diagnostics:
    """Finds out which conditions hold.

    `slowed` (ρ < 1, or less than ζ along a curve), statuses of the solver and of the task by name,
    `LABEL: EVENT` for the events of each constraint, and `held by LABEL` for constraints that keep
    V from falling as fast as asked: u is on one of their rows, and −∇V points beyond it.

    Args:
        stack: the constraints.

    Attributes:
        names: of the conditions, by bit.
    """

    def __init__(self, stack: ConstraintStack) -> None:
        self._stack = stack
        solver = [name for name in solver_status.NAMES if name != "ok"]
        task = [name for name in task_status.NAMES if name != "ok"]
        self._events = EventConditions(stack)
        held = [f"held by {label}" for label in stack.labels]
        self.names = ("slowed", *solver, *task, BOUNDS, *held, *self._events.names)
        bit_of = dict(zip(self.names, bits(self.names), strict=True))
        self._slowed, self._bounds = bit_of["slowed"], bit_of[BOUNDS]
        self._solver = [bit_of.get(name, 0) for name in solver_status.NAMES]
        self._task = [bit_of.get(name, 0) for name in task_status.NAMES]
        self._before_events = len(self.names) - len(self._events.names)
        self._rows = [
            (bit_of[f"held by {label}"], len(constraint.names))
            for label, constraint in zip(stack.labels, stack.constraints, strict=True)
            if not constraint.equality
        ]

    def look(self, found: int, rho: float, task: int, gradient: FloatArray, u: FloatArray) -> int:
        """Conditions of a cycle.

        Args:
            found, rho: of the solver.
            task: status of the task.
            gradient: ∇V, (n,).
            u: the answer, (n,) [rad/s or m/s].
        """
        present = self._solver[found] | self._task[task]
        present |= self._events.look() << self._before_events
        if rho < BELOW_ONE:
            present |= self._slowed | self._holders(gradient, u)
        return present

    def constraints_of(self, present: int) -> int:
        """Return the constraints that hold V back, by bit, of the conditions of a cycle."""
        return present // (self._bounds << 1) & ((1 << len(self._stack.labels)) - 1)

    def held_along(self, direction: FloatArray, most: FloatArray) -> int:
        """`slowed`, and by what: the u that goes furthest in a direction, (n,), is on its rows."""
        return self._slowed | self._holders(-direction, most)

    def _holders(self, gradient: FloatArray, u: FloatArray) -> int:
        stack, present, start = self._stack, 0, 0
        at_limit = ((stack.upper - u <= ACTIVE) & (gradient < 0.0)) | (
            (u - stack.lower <= ACTIVE) & (gradient > 0.0)
        )
        if at_limit.any():
            present |= self._bounds
        slack, outwards = stack.b - stack.A @ u, stack.A @ gradient < 0.0
        lengths = np.abs(stack.A).max(axis=1, initial=0.0)
        holding = outwards & (slack <= ACTIVE * lengths)
        for bit, rows in self._rows:
            if holding[start : start + rows].any():
                present |= bit
            start += rows
        return present
