"""Whether a loop around position servos that give way is slow enough for them."""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.controllers.base import Controller


def loop_rate(
    form: str, rate: tuple[float, float], jacobian: FloatArray, *, pseudo_inverse: bool = False
) -> float:
    """The largest rate at which a law with V̇ = −Ψ, V = |e|²/2, corrects joints [1/s].

    It is the largest eigenvalue of B in u = −B·(q − q_d), by the linear law that holds around each
    e. The least joint velocities, which QP12 has for γ = 0, are u = −(Ψ/|Jᵀe|²)·Jᵀe, so

        B = (Ψ/|Jᵀe|²)·JᵀJ,    λ_max(B) ≤ c·σ_max²/σ_min

    with c = (2/π)·u_max·β/√n for (16) as printed, as Ψ ≤ c·|Jᵀe|·|e|: a small error along an axis
    that joints move easily is corrected as hastily as a large one along an axis that they hardly
    move. The pseudo-inverse, u = −(Ψ/|e|²)·J⁺e, has not more than c·σ_max.

    Args:
        form: of Ψ, one of `descent_rate.FORMS`.
        rate: u_max and β of (16), or η and κ.
        jacobian: J of the task, (m, n).
        pseudo_inverse: of whose laws it is.
    """
    first, second = rate
    sizes = np.linalg.svd(jacobian, compute_uv=False)
    least, greatest = float(sizes[-1]), float(sizes[0])
    if not pseudo_inverse and least == 0.0:
        return math.inf
    if form in {"tanh", "exponential"}:
        return 0.5 * first * (1.0 if pseudo_inverse else (greatest / least) ** 2)
    share = 1.0 / math.sqrt(jacobian.shape[1]) if form == "inverse_sqrt_n" else 1.0
    c = 2.0 / math.pi * first * second * share
    return c * greatest * (1.0 if pseudo_inverse else greatest / least)


def too_fast(description: RobotDescription, rate: float, kinematics_from: str) -> str:
    """Why the certificate of a law does not count where servos give way; "" where it does.

    It is for joints that follow their reference. Where a law answers to what servos have made of
    that, it is a loop around them, and `servo_rate_1_s` says how fast that may be. Both rates are
    those of the start posture; what becomes of them on the way is not looked at.

    Args:
        description: of the robot.
        rate: `loop_rate` of the law [1/s].
        kinematics_from: "measured" or "reference".
    """
    limit = description.servo_rate_1_s
    if limit is None or kinematics_from == "reference" or rate < limit:
        return ""
    return f"loop {rate:.3g}/s >= servos {limit:.3g}/s"


def refuse_too_fast(controller: Controller, rate: float, kinematics_from: str) -> None:
    """Refuse a change after which nothing would be certified, as the law is too fast for servos.

    Args:
        controller: which is to change, and was not built so.
        rate, kinematics_from: as of `too_fast`.

    Raises:
        ConfigError: it would be so.
    """
    problem = too_fast(controller.description, rate, kinematics_from)
    if problem and not controller.too_fast:
        remedy = "Slow the law, or write kinematics_from: reference and restart"
        raise ConfigError("", "", None, f"nothing would be certified: {problem}", remedy)
