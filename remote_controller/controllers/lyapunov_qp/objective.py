"""The solver of each objective Φ that `stable_qp` can be given."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from hoap3.protocol.errors import BadProblemError, ConfigError, one_of
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.lyapunov_qp.settings import (
    LeastSquares,
    Lp,
    Parameters,
    Qp12Objective,
)
from hoap3.remote_controller.solvers.lyapunov_qp.lp_norm import LpNorm
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import StableQp

Solver: TypeAlias = StableQp | LpNorm

WITH_CONSTRAINTS = (1.0, 2.0, math.inf)


def exponent(objective: Lp) -> float:
    """P as a number."""
    return math.inf if objective.p == "inf" else float(objective.p)


def check_objective(parameters: Parameters) -> None:
    """Refuse an objective that does not go with the rest of the parameters.

    Raises:
        ConfigError: ℓp with constraints and a p other than 1, 2 and inf, or weighted without
            them; V̇ ≤ 0 with a norm, whose optimum is u = 0: the robot never moves.
    """
    objective = parameters.objective
    if isinstance(objective, Lp):
        if parameters.constraints and exponent(objective) not in WITH_CONSTRAINTS:
            problem = "is not supported with constraints"
            remedy = "Write 1, 2 or inf, or take the constraints out"
            raise ConfigError("", "objective.p", objective.p, problem, remedy)
        if objective.weights and not parameters.constraints:
            problem = "are not supported for lp without constraints"
            remedy = "Take them out, choose kind: qp12, or add the constraint joint_velocity"
            raise ConfigError("", "objective.weights", objective.weights, problem, remedy)
    if parameters.lyapunov == "descent" and not isinstance(objective, LeastSquares):
        problem = f"with {objective.kind} as Φ has the optimum u = 0: the robot never moves"
        remedy = "Write equality, or choose objective.kind: least_squares"
        raise ConfigError("", "lyapunov", "descent", problem, remedy)


def solver_of(parameters: Parameters, description: RobotDescription, m: int, k: int) -> Solver:
    """What solves (3) with m rows of inequalities and k of equations.

    Raises:
        ConfigError: an objective that does not fit the robot or the other parameters.
    """
    check_objective(parameters)
    objective, n = parameters.objective, description.n
    if isinstance(objective, Lp) and not parameters.constraints and not k:
        return LpNorm(n, exponent(objective))
    kind: str | float = exponent(objective) if isinstance(objective, Lp) else objective.kind
    try:
        return StableQp(
            n,
            m,
            k,
            objective=kind,
            gamma=objective.gamma if isinstance(objective, Qp12Objective) else 0.0,
            weights=_weights(objective, description),
            lyapunov=parameters.lyapunov,
            max_speed_ratio=parameters.max_speed_ratio if parameters.rho == "damped" else 0.0,
        )
    except BadProblemError as error:
        remedy = "Change the objective"
        raise ConfigError("", "objective", objective.kind, str(error), remedy) from error


def _weights(
    objective: Qp12Objective | Lp | LeastSquares, description: RobotDescription
) -> FloatArray | None:
    given = {} if isinstance(objective, LeastSquares) else objective.weights
    if not given:
        return None
    names, weights = list(description.joint_names), np.ones(description.n)
    for name, weight in given.items():
        if name not in names:
            problem = f"robot {description.name!r} has no such joint"
            remedy = one_of(name, names, "Joints")
            raise ConfigError("", f"objective.weights.{name}", weight, problem, remedy)
        weights[names.index(name)] = weight
    return weights
