"""Whether a loop around position servos that give way is slow enough for them."""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.description import RobotDescription
from hoap3.protocol.messages import FloatArray


def loop_rate(
    form: str, rate: tuple[float, float], jacobian: FloatArray, plain_gain: float = 0.0
) -> float:
    """The greatest rate λ at which a law brings e to 0, ė = −λ·e [1/s].

    With V̇ = −Ψ and V = |e|²/2 it is Ψ/|e|², at most where e vanishes: (2/π)·u_max·β·σ/√n for
    (16) as printed, with σ the largest singular value of J, as |∇V| = |Jᵀe| ≤ σ·|e|.

    Args:
        form: of Ψ, one of `descent_rate.FORMS`.
        rate: u_max and β of (16), or η and κ.
        jacobian: J of the task, (m, n).
        plain_gain: k of u = −k·J⁺e, which has no Ψ; 0 where V̇ = −Ψ.
    """
    if plain_gain:
        return plain_gain
    first, second = rate
    if form in {"tanh", "exponential"}:
        return 0.5 * first
    share = 1.0 / math.sqrt(jacobian.shape[1]) if form == "inverse_sqrt_n" else 1.0
    return 2.0 / math.pi * first * second * share * float(np.linalg.norm(jacobian, 2))


def slow_enough(description: RobotDescription, rate: float, kinematics_from: str) -> bool:
    """Whether the certificate of a law counts, though servos give way.

    It is for joints that follow their reference. Where a law answers to what servos have made of
    that, it is a loop around them, and `servo_rate_1_s` says how fast that may be.
    """
    limit = description.servo_rate_1_s
    return limit is None or kinematics_from == "reference" or rate < limit
