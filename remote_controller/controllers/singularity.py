"""A bounded posture motion that leaves a stationary point of V = ½|e|²."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated

import numpy as np
from pydantic import Field

from hoap3.protocol.messages import FloatArray, State
from hoap3.protocol.robot.description import RobotDescription

LEAVING = "leaving a singularity"
"""The condition of answers of this motion: nothing is certified in it."""
LeaveSingularity = Annotated[
    bool,
    Field(
        description="leave a posture in which a task is stationary by a motion of at most 0.05 rad "
        "or m of each joint, if V can fall that way"
    ),
]
STEP = 1e-6  # of each joint, for differences of the gradient [rad or m]
NEGLIGIBLE = 1e-5  # of the largest |eigenvalue|: a curvature up to this counts as 0
REACH = 0.05  # greatest displacement of a joint [rad or m], and
OF_RANGE = 0.1  # of its range
SPEED = 0.1  # of the greatest speed of a joint
ATTEMPTS = 3  # at one stationary point
ANOTHER = 0.01  # of V: a stationary point whose V differs by more is another one
TIMEOUT_S = 1.0  # beyond the time that the motion takes without limits of acceleration
INSIDE, MARGIN = 1.0 - 1e-9, 1e-9  # of the greatest acceleration, and of the range


class SingularityExit:
    """Finds and executes the motion.

    At a stationary point V falls in second order along directions of negative curvature. Its
    Hessian consists of differences of the gradient, a column in each tick, in which the robot
    stands still. Without a negative eigenvalue the point is a local minimum, such as an arm
    stretched towards a target out of its reach, and there is nothing to leave.

    Speed, acceleration and position stay within the robot's limits and the controller's bounds.

    Args:
        robot: its description.
        bounds: of the velocities, (n,) each, rewritten in place by the controller.
        gradient_at: ∇V at joint positions (n,) and a time [s].
    """

    def __init__(
        self,
        robot: RobotDescription,
        bounds: tuple[FloatArray, FloatArray],
        gradient_at: Callable[[FloatArray, float], FloatArray],
    ) -> None:
        from hoap3.remote_controller.constraints.joints.viability_kernels import velocity_bounds

        self._kernel, self._bounds, self._gradient_at = velocity_bounds, bounds, gradient_at
        most = np.minimum(INSIDE * robot.setpoint_acceleration_max, robot.brake_acceleration)
        ends = robot.lower + MARGIN, robot.upper - MARGIN
        self._limits = np.array([*ends, robot.velocity, most])
        self._reach = np.minimum(REACH, OF_RANGE * (robot.upper - robot.lower))
        with np.errstate(invalid="ignore"):  # of a joint without limits
            middle = 0.5 * (robot.lower + robot.upper)
        self._middle = np.where(np.isfinite(middle), middle, np.inf)
        self._T, self._hessian = robot.period_s, np.zeros((robot.n, robot.n))
        self._q, self._before, self._dq, self._origin = np.zeros((4, robot.n))
        self._rate, self._lower, self._upper, self.u = np.zeros((4, robot.n))
        np.linalg.eigh(np.eye(robot.n))  # its first call takes milliseconds
        self.reset()

    def reset(self) -> None:
        """Forget earlier attempts."""
        self._tick = self._periods = -1
        self._dq[:] = 0.0
        self._value, self._attempts, self._longest, self._ramp = -1.0, 0, 0, 1.0
        self.stop()

    def stop(self) -> None:
        """End the motion, if there is one."""
        self._active, self._rate[:] = False, 0.0
        self._since, self._column = -1, 0  # first tick of the motion; next column of the Hessian

    def advance(self, state: State, base: FloatArray, value: float, *, still: bool) -> bool:
        """Return whether the motion goes on, with its velocities in `u`.

        Args:
            state: of the robot.
            base: joint positions that the kinematics are those of, (n,).
            value: V there.
            still: whether a task is stationary and V does not fall.
        """
        repeated, self._tick = state.tick == self._tick, state.tick
        self._measure(state)
        if self._since >= 0:
            np.subtract(state.reference, self._origin, out=self._q)
            np.abs(self._q, out=self._q)
            if (self._q >= self._reach).any() or state.tick - self._since >= self._longest:
                self.stop()
        elif not still:
            self.stop()
        elif not repeated:
            self._active = self._examine(state, base, value)
        if not self._active:
            return False
        self._kernel(state.reference, self._dq, self._limits, self._T, self._lower, self._upper)
        rise = (state.tick - self._since + 1) / self._ramp if self._since >= 0 else 1.0
        np.multiply(self._rate, min(rise, 1.0), out=self.u)
        for least, most in ((self._lower, self._upper), self._bounds):
            np.fmax(self.u, least, out=self.u)  # a bound that is NaN is none
            np.fmin(self.u, most, out=self.u)
        return True

    def _measure(self, state: State) -> None:
        """Find how the commanded position has moved since the State before."""
        periods = state.tick - state.skipped
        if 0 <= self._periods < periods:
            np.subtract(state.reference, self._before, out=self._dq)
            self._dq /= (periods - self._periods) * self._T
        self._before[:], self._periods = state.reference, periods

    def _examine(self, state: State, base: FloatArray, value: float) -> bool:
        """Add a column to the Hessian, and begin the motion when it is complete.

        Returns:
            False where there is nothing to leave, or no attempt is left.
        """
        if abs(value - self._value) > ANOTHER * abs(self._value):
            self._value, self._attempts, self._column = value, 0, 0
        if self._attempts == ATTEMPTS:
            return False
        now, place = state.tick * self._T, self._column
        self._q[:] = base
        self._q[place] += STEP
        self._hessian[place] = self._gradient_at(self._q, now)
        self._hessian[place] -= self._gradient_at(base, now)  # the tasks are at `base` again
        self._column = (place + 1) % len(base)
        if self._column:
            return True
        direction = falling_direction(self._hessian, np.where(self._middle >= base, 1.0, -1.0))
        if direction is None:
            self._attempts = ATTEMPTS
            return False
        direction /= (np.abs(direction) / self._reach).max() * (-1.0) ** self._attempts
        duration = float((np.abs(direction) / (SPEED * self._limits[2])).max())
        np.divide(direction, duration, out=self._rate)
        self._ramp = max(1.0, float((np.abs(self._rate) / self._limits[3]).max()) / self._T)
        self._origin[:], self._since = state.reference, state.tick
        self._attempts += 1
        self._longest = math.ceil((duration + TIMEOUT_S) / self._T)
        return True


def falling_direction(hessian: FloatArray, preferred: FloatArray) -> FloatArray | None:
    """Return the projection of a direction onto the eigenvectors of negative eigenvalues.

    Args:
        hessian: (n, n), up to a factor.
        preferred: (n,). Where its projection nearly vanishes, the first eigenvector counts.

    Returns:
        None where no eigenvalue is negative, or one is not finite.
    """
    if not np.isfinite(hessian).all():
        return None
    values, vectors = np.linalg.eigh(0.5 * (hessian + hessian.T))
    falling = vectors[:, values < -NEGLIGIBLE * np.abs(values).max()]
    if not falling.size:
        return None
    found = np.asarray(falling @ (preferred @ falling))
    if np.linalg.norm(found) < 1e-3 * np.linalg.norm(preferred):
        found = falling[:, 0] * np.sign(falling[np.abs(falling[:, 0]).argmax(), 0])
    return found
