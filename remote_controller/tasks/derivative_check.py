"""Whether a function's gradient and rate are the derivatives of its value."""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.tasks.lyapunov import BuildContext, LyapunovFunction

STEP = 1e-6  # rad, m or s: rounding and curvature both stay far below the tolerance
TOLERANCE = 1e-4  # of the largest derivative
ROUNDING = 1e-14  # of the value
POSTURES = 3
TIMES_S = (0.3, 1.7)
CLOSE = 0.1  # share of each joint's range


def check_derivatives(function: LyapunovFunction, context: BuildContext, name: str) -> None:
    """Compare ∇V and ∂V/∂t with central differences of V, near the initial posture.

    The function is reset before, at time 0.

    Args:
        function: to be checked.
        context: robot, and where the function is configured.
        name: what the config calls the function, for the error.

    Raises:
        ConfigError: V is negative, something is not finite or has the wrong shape, or a
            derivative is another one; names the component and both figures.
    """
    description, kinematics = context.description, context.kinematics
    lower, upper = np.array(description.lower), np.array(description.upper)
    initial = np.array(description.initial_position)
    rng = np.random.default_rng(0)
    kinematics.update(initial)
    function.reset(kinematics, 0.0)
    for posture in range(POSTURES):
        q = initial + CLOSE * bool(posture) * (rng.uniform(lower, upper) - initial)
        for time_s in TIMES_S:
            _check_at(function, context, name, q, time_s)
    kinematics.update(initial)
    function.reset(kinematics, 0.0)


def _check_at(
    function: LyapunovFunction, context: BuildContext, name: str, q: FloatArray, time_s: float
) -> None:
    joints = context.description.joint_names

    def refuse(problem: str, remedy: str) -> ConfigError:
        return ConfigError(context.file, context.key, name, f"{problem} at t = {time_s} s", remedy)

    def value(at: FloatArray, time: float) -> float:
        context.kinematics.update(at)
        function.update(context.kinematics, time)
        return float(function.value)

    here = value(q, time_s)
    gradient, rate = np.array(function.gradient, float), float(function.rate)
    if gradient.shape != (len(joints),):
        raise refuse(f"gradient has shape {gradient.shape}", f"Make it ({len(joints)},)")
    components = [("value", here), ("rate", rate)]
    components += [(f"gradient[{i}] ({joint})", gradient[i]) for i, joint in enumerate(joints)]
    for component, number in components:
        if not math.isfinite(number):
            raise refuse(f"{component} is {number}", "Make it a finite number everywhere")
    if here < 0.0:
        raise refuse(f"value is {here:.6g}", "V ≥ 0 is needed, and 0 at the target only")
    ends = [
        (value(q + shift, time_s), value(q - shift, time_s)) for shift in STEP * np.eye(len(joints))
    ]
    ends.append((value(q, time_s + STEP), value(q, time_s - STEP)))
    ahead, behind = np.array(ends).T
    slopes = (ahead - behind) / (2.0 * STEP)
    bend = (ahead - 2.0 * here + behind) / (2.0 * STEP)  # where V is least, q's rounding shows
    given = np.append(gradient, rate)
    largest = np.max(np.abs([slopes, bend, given]))
    wrong = np.abs(given - slopes) - TOLERANCE * largest - ROUNDING * abs(here) / STEP
    if not np.all(wrong <= 0.0):
        worst = int(np.argmax(wrong))
        component = "rate (∂V/∂t)"
        if worst < len(joints):
            component = f"gradient[{worst}] ({joints[worst]})"
        raise refuse(
            f"{component} is {given[worst]:.6g}, but value has the difference quotient "
            f"{slopes[worst]:.6g}",
            "Correct the one or the other",
        )
