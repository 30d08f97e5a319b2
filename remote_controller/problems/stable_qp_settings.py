"""The parameters of `stable_qp`, complete; a test compares the defaults with the controller's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hoap3.remote_controller.problems.oracles.parameters import UnverifiableError, complete

FORMS = ("inverse_sqrt_n", "one", "max_norm", "tanh", "exponential")
DEFAULTS: dict[str, Any] = {
    "task": None,
    "objective": None,
    "psi": None,
    "constraints": None,
    "lyapunov": ("equality", "descent"),
    "rho": ("damped", "largest"),
    "max_speed_ratio": 10.0,
    "kinematics_from": ("measured", "reference"),
    "integrate_from": ("reference", "measured"),
    "leave_singularity": (False, True),
}
PSI: dict[str, Any] = {
    "form": FORMS,
    "u_max_rad_s": 0.6,
    "beta": 46.0,
    "eta_per_s": 1.0,
    "kappa": 10.0,
    "ramp_s": 0.0,
}
OBJECTIVES: dict[str, dict[str, Any]] = {
    "qp12": {"kind": "qp12", "gamma": 0.5, "adaptive_gamma": (False, True), "gamma_slope": 100.0}
    | {"weights": None},
    "lp": {"kind": "lp", "p": None, "weights": None},
    "least_squares": {"kind": "least_squares", "gain_per_s": 1.0},
}
ENTRY: dict[str, Any] = {"constraint": str, "name": None, "parameters": None}
TASK: dict[str, Any] = {"task": str, "parameters": None}


@dataclass(frozen=True)
class Settings:
    """What a config says, each part complete.

    Attributes:
        task: `task` and `parameters`; None: the robot's default task.
        objective, psi: of Φ and Ψ.
        constraints: names, and parameters as they are given.
        rest: all other keys.
    """

    task: Mapping[str, Any] | None
    objective: Mapping[str, Any]
    psi: Mapping[str, Any]
    constraints: tuple[tuple[str, object], ...]
    rest: Mapping[str, Any]

    @classmethod
    def of(cls, parameters: Mapping[str, Any]) -> Settings:
        """The settings of a log's config.

        Raises:
            UnverifiableError: something in it cannot be reckoned with.
        """
        rest = complete(parameters, DEFAULTS, "parameters")
        kind = (rest["objective"] or {}).get("kind", "qp12")
        if kind not in OBJECTIVES:
            raise UnverifiableError(f"parameter objective.kind is {kind!r:.40}")
        objective = complete(rest["objective"], OBJECTIVES[kind], "objective")
        task = None if rest["task"] is None else complete(rest["task"], TASK, "task")
        entries = [complete(entry, ENTRY, "constraints") for entry in rest["constraints"] or ()]
        return cls(
            task,
            objective,
            complete(rest["psi"], PSI, "psi"),
            tuple((entry["constraint"], entry["parameters"]) for entry in entries),
            rest,
        )
