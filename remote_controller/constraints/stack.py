"""Several constraints as one problem's A u ≤ b, C u = c and lower ≤ u ≤ upper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hoap3.protocol.messages import FloatArray, State
from hoap3.remote_controller.constraints.constraint import Constraint
from hoap3.remote_controller.constraints.joints.joint_velocity import JointVelocity
from hoap3.remote_controller.model.kinematics import Kinematics
from hoap3.remote_controller.scheduling.changes import Part, part_of


class Stack:
    """Constraints of one robot, and what is known of all of them after an update.

    Args:
        constraints: of one robot.
        labels: what each is called; the names of rows and margins begin with it.
    """

    def __init__(self, constraints: Sequence[Constraint], labels: Sequence[str]) -> None:
        self.constraints, self.labels = tuple(constraints), tuple(labels)
        self._with_margins = [
            each for each in self.constraints if each.margins.size or overrides(each, "margin")
        ]

    def parts(self) -> list[Part]:
        """Parameters of the constraints, for live changes of their numbers."""
        found: list[Part] = []
        for i, (label, constraint) in enumerate(zip(self.labels, self.constraints, strict=True)):
            found += part_of(constraint, ("constraints", label), ("constraints", i))
        return found

    def reset(self) -> None:
        """Forget what was kept from earlier states."""
        for constraint in self.constraints:
            constraint.reset()

    def margin(self) -> float:
        """Smallest true margin of the last update, inequalities only; inf where there is none."""
        return min((constraint.margin() for constraint in self._with_margins), default=np.inf)

    def drift(self) -> float:
        """Largest error of the last update that equations shall keep at 0 [m or rad]."""
        return max((constraint.drift() for constraint in self.constraints), default=0.0)

    def tightest(self) -> str:
        """Label and name of what has the smallest margin; "" where there is none."""
        return self.tightest_with_unit()[0]

    def tightest_with_unit(self) -> tuple[str, str]:
        """The same, and the unit of that margin."""
        least = self.margin()
        for label, constraint in zip(self.labels, self.constraints, strict=True):
            if constraint.margins.size and constraint.margin() == least:
                return f"{label}: {constraint.tightest()}", constraint.tightest_unit()
        return "", ""

    def events(self) -> dict[str, int]:
        """How often something happened, as `label: event`; what never did is left out."""
        return {
            f"{label}: {event}": count
            for label, constraint in zip(self.labels, self.constraints, strict=True)
            for event, count in constraint.events.items()
            if count
        }


class EventConditions:
    """Events of constraints as conditions of a controller: `LABEL: EVENT`.

    Args:
        stack: the constraints.

    Attributes:
        names: of all events that can happen.
    """

    def __init__(self, stack: Stack) -> None:
        self._events = [
            (label, constraint.events, event)
            for label, constraint in zip(stack.labels, stack.constraints, strict=True)
            for event in constraint.events
        ]
        self.names = tuple(f"{label}: {event}" for label, _, event in self._events)
        self._counted = [0] * len(self._events)

    def look(self) -> int:
        """Bit i: event `names[i]` was counted since the last look."""
        present = 0
        for place, (_, counts, event) in enumerate(self._events):
            if counts[event] != self._counted[place]:
                self._counted[place] = counts[event]
                present |= 1 << place
        return present


class ConstraintStack(Stack):
    """Constraints one below the other, in preallocated arrays that every update rewrites.

    Bounds on the speed of joints come first, whatever the order, so no other entry can ask a
    joint for more than it can do.

    Args:
        constraints: of one robot.
        labels: what each is called; the names of rows and margins begin with it.
        n: number of joints.

    Attributes:
        A, b: (s, n), (s,) A·u ≤ b; unused rows are 0·u ≤ inf.
        C, c: (k, n), (k,) C·u = c; unused rows are 0·u = 0.
        lower, upper: (n,) of u [rad/s or m/s]; ∓inf where nothing bounds a joint.
        names, equality_names: of the rows of A and of C.
    """

    def __init__(self, constraints: Sequence[Constraint], labels: Sequence[str], n: int) -> None:
        from hoap3.remote_controller.constraints.limit_kernels import slow_returns

        self._slow_returns = slow_returns
        super().__init__(constraints, labels)
        self.names = self._row_names(equality=False)
        self.equality_names = self._row_names(equality=True)
        self.A, self.b = np.zeros((len(self.names), n)), np.full(len(self.names), np.inf)
        self.C, self.c = np.zeros((len(self.equality_names), n)), np.zeros(len(self.equality_names))
        self.lower, self.upper = np.full(n, -np.inf), np.full(n, np.inf)
        self._views: list[tuple[Constraint, FloatArray, FloatArray]] = []
        self._judges: list[tuple[str, Constraint, FloatArray, FloatArray]] = []
        taken = {False: 0, True: 0}
        for label, constraint in zip(self.labels, self.constraints, strict=True):
            kind = constraint.equality
            rows = slice(taken[kind], taken[kind] + constraint.rows)
            matrix, vector = (self.C, self.c) if kind else (self.A, self.b)
            if constraint.rows:
                self._views.append((constraint, matrix[rows], vector[rows]))
            if overrides(constraint, "accepts"):
                self._judges.append((label, constraint, matrix[rows], vector[rows]))
            taken[kind] += constraint.rows
        self._bounding = sorted(
            (each for each in self.constraints if overrides(each, "bounds")),
            key=lambda constraint: not isinstance(constraint, JointVelocity),
        )

    def update(self, kinematics: Kinematics, state: State) -> None:
        """Rewrite all arrays for a state; `kinematics` is up to date."""
        self.lower[:], self.upper[:] = -np.inf, np.inf
        for constraint in self._bounding:
            constraint.bounds(state, self.lower, self.upper)
        for constraint, matrix, vector in self._views:
            constraint.update(kinematics, state, matrix, vector)
            if constraint.yields and constraint.margin() < 0.0:
                self._slow_returns(matrix, vector, self.lower, self.upper)

    def reject(self, gradient: FloatArray) -> str:
        """Switch off the rows under which V cannot be promised to decrease, after `update`.

        Args:
            gradient: ∇V, (n,).

        Returns:
            Label of the first constraint that was switched off; "" if none was.
        """
        rejected = ""
        for label, constraint, matrix, vector in self._judges:
            if not constraint.accepts(gradient):
                matrix[:], vector[:] = 0.0, 0.0 if constraint.equality else np.inf
                rejected = rejected or label
        return rejected

    def _row_names(self, equality: bool) -> tuple[str, ...]:
        return tuple(
            f"{label}: {name}"
            for label, constraint in zip(self.labels, self.constraints, strict=True)
            if constraint.equality == equality
            for name in constraint.names
        )


def overrides(constraint: Constraint, method: str) -> bool:
    """Whether it does something of its own, so that it need not be asked each cycle for nothing."""
    return getattr(type(constraint), method) is not getattr(Constraint, method)
