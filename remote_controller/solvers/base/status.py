"""What a solver says of its work.

Kernels take these numbers as constants, so this file counts as one of their sources.
"""

from __future__ import annotations

OK = 0
INFEASIBLE = 1
BAD_INPUT = 2
BAD_SHAPE = 3
OUT_OF_RANGE = 4
STATIONARY = 5  # the constraints let V fall no further (ρ* = 0): u = 0 is the answer
ZERO_GRADIENT = 6  # ∇V = 0, yet V should change: no u does that
INFEASIBLE_CONSTRAINTS = 7  # no u satisfies the constraints, whatever V does
UNBOUNDED = 8  # V can fall as fast as one likes: no largest ρ
CANNOT_DESCEND = 9  # V has to rise (ρ < 0); u makes it rise as little as possible
DESCENDS_FASTER = 10  # V falls faster than asked (ρ > 1); u slows it as far as possible
UNSOLVED = 11  # the solver gave up
ITERATION_LIMIT = (
    12  # the budget of iterations was too small: the best that is known, not the optimum
)

NAMES = (
    "ok",
    "infeasible",
    "bad_input",
    "bad_shape",
    "out_of_range",
    "stationary",
    "zero_gradient",
    "infeasible_constraints",
    "unbounded",
    "cannot_descend",
    "descends_faster",
    "unsolved",
    "iteration_limit",
)
