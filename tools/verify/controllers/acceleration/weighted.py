"""`weighted`: all tasks share one acceleration (Liu, Tan and Padois, 2015, (12)).

min Σ ω_i |J_i q̈ − b_i|² + ω_r |q̈ + d·q̇|² + ω_r |τ − o|² within the bounds; o is h, or 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.oracles import acceleration_bounds_oracle as bounds
from hoap3.remote_controller.problems.oracles.tasks.acceleration_oracle import ROUNDING
from hoap3.remote_controller.problems.schedule import Weights
from hoap3.remote_controller.solvers.qp.reference import solve_qp
from hoap3.tools.verify.claims import Claims
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.controllers.acceleration.certificate import Solution
from hoap3.tools.verify.controllers.acceleration.fallbacks import (
    BRAKE_PER_S,
    Soft,
    nearest_to,
)
from hoap3.tools.verify.controllers.acceleration.family import Family, braking, check_family
from hoap3.tools.verify.controllers.acceleration.hierarchy import Cycles, Hierarchy
from hoap3.tools.verify.controllers.acceleration.quadratic import optimum_of

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Settings = Mapping[str, Any]

DEFAULTS: dict[str, Any] = {
    "constraints": None,
    "bounds": bounds.HIERARCHY_DEFAULTS,
    "compensate_friction": True,
    "w_r": 0.01,
    "null_damping_per_s": 10.0,
    "regularise": "gravity_compensated",
    "priorities": {},
}


class Weighted(Family):
    """One QP of all."""

    defaults, proves = DEFAULTS, False

    def schedule(self, names: list[str], settings: Settings) -> Weights:
        """The weights."""
        return Weights(names, settings["priorities"])

    def tops(self, numbers: Array) -> Flags:
        """All tasks with weight."""
        return numbers > 0.0

    def solution(self, cycles: Cycles, hierarchy: Hierarchy, settings: Settings) -> Solution:
        """By its KKT conditions."""
        problem = _problem(cycles, hierarchy, settings)
        return Solution(*optimum_of(*problem, cycles, hierarchy.torque_max), self.proves)

    def soft(self, cycles: Cycles, hierarchy: Hierarchy, settings: Settings) -> list[Soft]:
        """What is nearest to the optimum with strong motors."""
        H, f, _ = _problem(cycles, hierarchy, settings)
        one, found = np.eye(f.shape[1]), []
        for each in zip(H, -f, cycles.lower, cycles.upper, -BRAKE_PER_S * cycles.dq, strict=True):
            wish = solve_qp(*each[:2], one, *each[2:4])
            found.append(nearest_to(each[4] if wish is None else wish))
        return found


def _problem(
    cycles: Cycles, hierarchy: Hierarchy, settings: Settings
) -> tuple[Array, Array, Array]:
    """H (N, n, n), f (N, n), and how exactly that is known."""
    each, w = np.repeat(cycles.numbers, hierarchy.sizes, axis=1), settings["w_r"]
    J, y, M = cycles.rows.jacobian, cycles.wanted, cycles.mass
    weighted = np.swapaxes(each[..., None] * J, 1, 2)
    H = weighted @ J + w * np.eye(J.shape[2])
    f = -(weighted @ y[..., None])[..., 0] - w * braking(cycles, settings, hierarchy)
    if settings["regularise"] != "none":
        H += w * M @ M
    if settings["regularise"] == "torque":
        f += w * (M @ cycles.bias[..., None])[..., 0]
    doubt = cycles.wanted_exact + ROUNDING * np.abs(y)
    f_exact = (np.abs(weighted) @ doubt[..., None])[..., 0]
    size = np.abs(cycles.bias).max(1, keepdims=True)
    f_exact += ROUNDING * w * np.abs(M).sum(2) * size
    return H, f, f_exact


def check(run: ControllerRun, parameters: Settings, claims: Claims) -> None:
    """Everything that an answer of `weighted` says."""
    check_family(Weighted(), run, parameters, claims)
