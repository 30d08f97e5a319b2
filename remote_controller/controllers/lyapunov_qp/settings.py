"""Settings of `stable_qp`: the task, Φ, Ψ and the constraints, each chosen on its own."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from hoap3.protocol.config.changeable import CHANGEABLE
from hoap3.protocol.config.settings import Settings
from hoap3.remote_controller.constraints.registry import ConstraintSettings
from hoap3.remote_controller.controllers.base import VelocityController
from hoap3.remote_controller.controllers.ramp import RampTime
from hoap3.remote_controller.controllers.singularity import LeaveSingularity
from hoap3.remote_controller.solvers.lyapunov_qp.descent_rate import GAMMA_SLOPE, Form
from hoap3.remote_controller.tasks.registry import TaskSettings

Positive = Annotated[float, Field(gt=0)]
Weights = dict[str, Positive]


class Qp12Objective(Settings):
    """Φ = γ|W u|₁ + (1−γ)/2·|W u|₂²."""

    kind: Literal["qp12"] = "qp12"
    gamma: float = Field(
        0.5,
        ge=0,
        le=1,
        description="0: all joints; towards 1: few",
        json_schema_extra=CHANGEABLE,
    )
    adaptive_gamma: bool = Field(
        False, description="γ·(2/π)·atan(gamma_slope·|∇V|) instead of γ: no chattering at the end"
    )
    gamma_slope: float = Field(
        GAMMA_SLOPE, gt=0, le=1e12, description="of the adaptive γ over |∇V|, in 1/|∇V|"
    )
    weights: Weights = Field({}, description="W: weight of a joint by its name, 1 by default")


class Lp(Settings):
    """Φ = |W u|_p: one joint for p ≤ 1, all alike for p = inf (Example 2)."""

    kind: Literal["lp"]
    p: Positive | Literal["inf"] = Field(description="with constraints only 1, 2 and inf")
    weights: Weights = Field(
        {}, description="W: weights of joints by name, else 1; with constraints only"
    )


class LeastSquares(Settings):
    """Φ of the task itself: of a curve φ in (23), else ½|de/dt + g·e|² of its error e."""

    kind: Literal["least_squares"]
    gain_per_s: float = Field(
        1.0,
        gt=0,
        description="g [1/s]; without effect on curves",
        json_schema_extra=CHANGEABLE,
    )


Objective = Annotated[Qp12Objective | Lp | LeastSquares, Field(discriminator="kind")]


class RateSettings(Settings):
    """Ψ, the rate at which V shall fall; what constraints leave of it is ρΨ."""

    form: Form = Field(
        "inverse_sqrt_n",
        description="u_max·|∇V|₂·R/√n as (16) has it, without 1/√n, u_max·|∇V|∞·R, "
        "η·V·tanh(κ|∇V|), or η·V",
    )
    u_max_rad_s: float = Field(
        0.6,
        gt=0,
        description="u_max of the forms that have it [rad/s or m/s]",
        json_schema_extra=CHANGEABLE,
    )
    beta: float = Field(
        46.0,
        gt=0,
        description="β of R = (2/π)·atan(β|e|), (41) [1/m]",
        json_schema_extra=CHANGEABLE,
    )
    eta_per_s: float = Field(
        1.0, gt=0, description="η of tanh and exponential [1/s]", json_schema_extra=CHANGEABLE
    )
    kappa: float = Field(
        10.0, gt=0, description="κ of tanh, in 1/|∇V|", json_schema_extra=CHANGEABLE
    )
    ramp_s: RampTime = 0.0


class Parameters(VelocityController.Parameters):
    """Problem (3), choice by choice."""

    hints: ClassVar = {
        "solver": "It was removed in 0.3: daqp solves the QP",
        **{key: f"Write objective.{key}" for key in ("gamma", "adaptive_gamma", "gamma_slope")},
        **{key: f"Write psi.{key}" for key in ("u_max_rad_s", "beta", "ramp_s")},
        "psi_scale": "Write psi.form",
        **dict.fromkeys(
            ("point", "frame", "reference_frame", "target_m"), "Write task, or use qp12"
        ),
    }

    task: TaskSettings | None = Field(
        None, description="what V is; null: the default task of the robot"
    )
    objective: Objective = Field(Qp12Objective(), description="Φ: qp12, lp or least_squares")
    psi: RateSettings = Field(RateSettings(), description="Ψ: how fast V shall fall")
    constraints: tuple[ConstraintSettings, ...] = Field((), description="what u must keep")
    lyapunov: Literal["equality", "descent"] = Field(
        "equality",
        description="∇V·u + ∂V/∂t = −ρΨ, or ≤ 0 whatever Ψ (Remark 1; not with a norm as Φ)",
    )
    rho: Literal["damped", "largest"] = Field(
        "damped",
        description="share of Ψ where constraints are in the way: what is worth its speed, or (6)",
    )
    max_speed_ratio: float = Field(
        10.0,
        gt=0,
        description="of damped: Ψ is asked for in full up to so many times the speed that one "
        "joint alone would need",
    )
    kinematics_from: Literal["measured", "reference"] = Field(
        "measured", description="joint positions that kinematics are computed from"
    )
    leave_singularity: LeaveSingularity = False
