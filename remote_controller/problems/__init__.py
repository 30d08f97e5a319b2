"""What a controller solves in each cycle, stated as data, and a check of the logged answer.

A `ProblemBuilder` reads the events of a log and states the problem of each answer: numbers from
plain numpy and Pinocchio, without the controller and its kernels. `check` says whether the answer
solves that problem; it knows no controller. A controller of your own names its builder in
`problem_type`.
"""

from hoap3.remote_controller.problems.history import ProblemBuilder
from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError
from hoap3.remote_controller.problems.statement import (
    Cascade,
    Claim,
    ClosedForm,
    GainProgram,
    Level,
    MaximalRate,
    Program,
    Rows,
    Statement,
)
from hoap3.remote_controller.problems.velocity_answer import VelocityAnswer

__all__ = [
    "Cascade",
    "Claim",
    "ClosedForm",
    "GainProgram",
    "Level",
    "MaximalRate",
    "ProblemBuilder",
    "Program",
    "Rows",
    "Statement",
    "UnverifiableError",
    "VelocityAnswer",
]
