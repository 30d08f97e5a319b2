"""Whether a function's gradient and rate, and those of its error, are the derivatives."""

from __future__ import annotations

import math

import numpy as np

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.tasks.lyapunov import BuildContext, LyapunovFunction

STEP = 1e-6  # rad, m or s: rounding and curvature both stay far below the tolerance
TOLERANCE = 1e-4  # of the largest derivative
ROUNDING = 1e-14  # of the value, and of an error or 1
SQUARE = 1e-9  # of V, by which it may differ from ½|e|²
POSTURES = 3
TIMES_S = (0.3, 1.7)
CLOSE = 0.1  # share of each joint's range


def check_derivatives(
    function: LyapunovFunction, context: BuildContext, name: str, *, of_error: bool = True
) -> None:
    """Compare ∇V and ∂V/∂t, ∂e/∂q and ∂e/∂t with central differences, near the initial posture.

    The function is reset before, at time 0. Of one without an error V alone is looked at; else
    V = ½|e|² is, too.

    Args:
        function: to be checked.
        context: robot, and where the function is configured.
        name: what the config calls the function, for the error.
        of_error: whether its error is looked at; not where only |error| is said to be continuous.

    Raises:
        ConfigError: V is negative or not ½|e|², something is not finite or has the wrong shape, or
            a derivative is another one; names the component and both figures.
    """
    description, kinematics = context.description, context.kinematics
    lower, upper = description.sampling_range
    initial = np.array(description.initial_position)
    rng = np.random.default_rng(0)
    kinematics.update(initial)
    function.reset(kinematics, 0.0)
    for posture in range(POSTURES):
        q = initial + CLOSE * bool(posture) * (rng.uniform(lower, upper) - initial)
        for time_s in TIMES_S:
            _Check(function, context, name, q, time_s, of_error).run()
    kinematics.update(initial)
    function.reset(kinematics, 0.0)


class _Check:
    """At one posture and one time."""

    def __init__(
        self,
        function: LyapunovFunction,
        context: BuildContext,
        name: str,
        q: FloatArray,
        time_s: float,
        of_error: bool,
    ) -> None:
        self._function, self._context, self._name = function, context, name
        self._of_error = of_error
        self._q, self._time = q, time_s
        self._joints = context.description.joint_names

    def run(self) -> None:
        """Refuse what is wrong."""
        function, n = self._function, len(self._joints)
        here = self._look(self._q, self._time)  # V, and e below it
        m = here.size - 1
        shapes: dict[str, tuple[int, ...]] = {"gradient": (n,)}
        if m:
            shapes |= {"jacobian": (m, n), "error_rate": (m,)}
        given = {component: np.array(getattr(function, component), float) for component in shapes}
        for component, shape in shapes.items():
            if given[component].shape != shape:
                problem = f"{component} has shape {given[component].shape}"
                raise self._refuse(problem, f"Make it {shape}")
        slopes = np.empty((m + 1, n + 1))
        slopes[0] = *given["gradient"], function.rate
        if m:
            slopes[1:, :n], slopes[1:, n] = given["jacobian"], given["error_rate"]
        self._check_values(here, slopes)
        ends = [
            (self._look(self._q + shift, self._time), self._look(self._q - shift, self._time))
            for shift in STEP * np.eye(n)
        ]
        times = self._time + STEP, self._time - STEP
        ends.append((self._look(self._q, times[0]), self._look(self._q, times[1])))
        ahead, behind = np.array(ends).transpose(1, 2, 0)
        bends = (ahead - 2.0 * here[:, None] + behind) / (2.0 * STEP)
        quotients = (ahead - behind) / (2.0 * STEP)
        rounding = ROUNDING * np.maximum(np.abs(here), [0.0] + [1.0] * m) / STEP
        for rows in (slice(1, None), slice(0, 1))[not m :]:
            # where V is least, q's rounding shows in the bend
            largest = np.max(np.abs([quotients[rows], bends[rows], slopes[rows]]))
            wrong = np.abs(slopes[rows] - quotients[rows]) - TOLERANCE * largest
            wrong -= rounding[rows, None]
            if not np.all(wrong <= 0.0):
                row, column = divmod(int(np.argmax(wrong)), n + 1)
                row += rows.start
                raise self._refuse(
                    f"{self._derivative(row, column)} is {slopes[row, column]:.6g}, but "
                    f"{self._value(row)} has the difference quotient {quotients[row, column]:.6g}",
                    "Correct the one or the other",
                )

    def _look(self, q: FloatArray, time_s: float) -> FloatArray:
        """V and e, (1 + m,); m = 0 where the error is not looked at."""
        self._context.kinematics.update(q)
        self._function.update(self._context.kinematics, time_s)
        error = self._function.error if self._of_error else ()
        return np.array([self._function.value, *error], float)

    def _check_values(self, here: FloatArray, slopes: FloatArray) -> None:
        """V, e and all derivatives are numbers, and V is what it shall be."""
        rows = *range(1, here.size), 0  # V may be made from e
        told = [(self._value(row), here[row]) for row in rows]
        told += [
            (self._derivative(row, column), number)
            for row in rows
            for column, number in enumerate(slopes[row])
        ]
        for name, number in told:
            if not math.isfinite(number):
                raise self._refuse(f"{name} is {number}", "Make it a finite number everywhere")
        value, square = here[0], 0.5 * float(here[1:] @ here[1:])
        if value < 0.0:
            remedy = "V ≥ 0 is needed, and 0 at the target only"
            raise self._refuse(f"value is {value:.6g}", remedy)
        if here.size > 1 and abs(value - square) > SQUARE * max(value, square):
            problem = f"value is {value:.6g}, but ½|error|² is {square:.6g}"
            raise self._refuse(problem, "Make V that of the error, with its weights, or give none")

    def _refuse(self, problem: str, remedy: str) -> ConfigError:
        file, key = self._context.file, self._context.key
        return ConfigError(file, key, self._name, f"{problem} at t = {self._time} s", remedy)

    def _value(self, row: int) -> str:
        return f"error[{row - 1}]" if row else "value"

    def _derivative(self, row: int, column: int) -> str:
        """What users call a derivative."""
        place = f"[{row - 1}" if row else ""
        if column == len(self._joints):
            return f"error_rate{place}] (∂e/∂t)" if row else "rate (∂V/∂t)"
        name = f"jacobian{place}, {column}]" if row else f"gradient[{column}]"
        return f"{name} ({self._joints[column]})"
