"""The solver of each objective Φ that `stable_qp` can be given."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.errors import (
    BadProblemError,
    ConfigError,
    InfeasibleError,
    UnknownNameError,
    one_of,
)
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.controllers.lyapunov_qp.settings import (
    LeastSquares,
    Lp,
    Parameters,
    Qp12Objective,
)
from hoap3.remote_controller.solvers.base import status
from hoap3.remote_controller.solvers.lyapunov_qp.lp_norm import LpNorm
from hoap3.remote_controller.solvers.lyapunov_qp.stable_qp import FREE, STILL, StableQp

Solver: TypeAlias = "StableQp | FreeLp"

WITH_CONSTRAINTS = (1.0, 2.0, math.inf)


class FreeLp:
    """min |u|_p with V̇ = −Ψ and nothing else, any p > 0, in the words of `StableQp`."""

    def __init__(self, n: int, p: float) -> None:
        self._solver, self._p = LpNorm(n), p
        self.gamma = 0.0
        self.u = np.zeros(n)
        self.path, self.margin, self.rho = FREE, math.inf, 1.0
        self.rate = self.required = 0.0
        self.kkt_residual = math.inf

    def forget(self) -> None:
        """Nothing is kept."""

    def solve(self, gradient: FloatArray, psi: float, drift: float, *_: object) -> int:
        """Find u, whatever else is given: there are no constraints."""
        self.required, self.path = -psi, FREE
        try:
            self._solver.solve(gradient, psi + drift, self._p, self.u)
            found = status.OK
        except InfeasibleError:
            found = status.ZERO_GRADIENT
        except BadProblemError:
            found = status.BAD_INPUT
        if found != status.OK:
            self.u[:], self.path = 0.0, STILL
        self.rate = float(gradient @ self.u) + drift
        self.kkt_residual = self._solver.kkt_residual
        self.rho = 1.0 if found == status.OK else 0.0
        return found


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
    if parameters.keep_rho and parameters.rho != "largest":
        problem, remedy = (
            "is not supported with a damped ρ",
            "Write rho: largest, or keep_rho: false",
        )
        raise ConfigError("", "keep_rho", True, problem, remedy)
    if parameters.lyapunov == "descent" and not isinstance(objective, LeastSquares):
        problem = f"with {objective.kind} as Φ has the optimum u = 0: the robot never moves"
        remedy = "Write equality, or choose objective.kind: least_squares"
        raise ConfigError("", "lyapunov", "descent", problem, remedy)


def solver_of(parameters: Parameters, description: RobotDescription, m: int, k: int) -> Solver:
    """What solves (3) with m rows of inequalities and k of equations.

    Raises:
        ConfigError: an objective that does not fit the robot or the other parameters, or a QP
            solver that is not installed.
    """
    check_objective(parameters)
    objective, n = parameters.objective, description.n
    if isinstance(objective, Lp) and not parameters.constraints and not k:
        return FreeLp(n, exponent(objective))
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
            keep_rho=parameters.keep_rho,
            solver=parameters.solver,
        )
    except UnknownNameError as error:
        remedy = "Write daqp, or install it"
        raise ConfigError("", "solver", parameters.solver, str(error), remedy) from error
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
