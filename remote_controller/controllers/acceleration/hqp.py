"""Strict levels one after the other: the hierarchical baseline of `ghc`."""

from __future__ import annotations

import math

from hoap3.protocol.errors import SolverError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.controllers.acceleration.ghc import RankedController
from hoap3.remote_controller.solvers.ghc.hqp import hqp

ABOVE = 0.5  # a task of that priority over another, or more, is a level above it


class HqpController(RankedController):
    """The damped null-space cascade of `solvers.ghc.hqp`, on the levels of the present priorities.

    A task stands below all that have a priority of more than ½ over it; what is more than half
    removed is left out. So where priorities move, levels jump once. Tasks in a cycle share a level.
    ω_r damps every level.

    A baseline: it allocates, and nothing of it is certified.
    """

    levels: list[list[int]]

    def count(self, out: FloatArray) -> None:
        """Write the matrix, and find its levels."""
        super().count(out)
        self.levels = levels_of(self.importance.alpha)
        self.tops[:] = False
        self.tops[self.levels[0] if self.levels else []] = True

    def solve(self, torque_max: FloatArray) -> bool:
        """Level by level."""
        tasks, given = self.tasks, self.problem
        try:
            self.found[:], self.effort[:] = hqp(
                *given.with_rest,
                [*tasks.sizes, len(given.bias)],
                [*self.levels, [len(tasks.sizes)]],
                given.mass,
                given.bias,
                self.w_r,
                given.limits(torque_max),
            )
        except SolverError:
            return False
        return math.isfinite(float(self.effort.sum()))


def levels_of(alpha: FloatArray) -> list[list[int]]:
    """Tasks by level, highest first, of a matrix of priorities, (k, k).

    On the highest are those that stand above whatever stands above them: what is alone there, and
    cycles; then the same of what is left.
    """
    left = [i for i in range(len(alpha)) if alpha[i, i] <= ABOVE]
    above = [{j for j in left if j != i and alpha[i, j] > ABOVE} for i in range(len(alpha))]
    levels: list[list[int]] = []
    for middle in left:  # above all those that stand above one of them (Warshall)
        for i in left:
            if middle in above[i]:
                above[i] |= above[middle]
    while left:
        level = [i for i in left if all(i in above[j] for j in above[i].intersection(left))]
        levels.append(level)
        left = [i for i in left if i not in level]
    return levels
