"""Bounds of the acceleration within which a joint stays able to keep its limits.

A joint that may brake with A, is D from its limit and moves towards it with v must have
v ≤ √(2AD), or it will not stop in time; a bound that looks one control step ahead only lets it
come there. `AccelerationBounds` gives, for every state, exactly those accelerations that can be
held for one period and leave the joint able to stop (`viability_bounds_kernels` has the formulas
and their source). The controller and the robot use the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoap3.protocol.errors import BadProblemError
from hoap3.protocol.messages import FloatArray

_SHRINK = "lower the acceleration or the period, or have it shrunk"


def refuse_joint(
    wrong: NDArray[np.bool_], names: Sequence[str], problem: str, *figures: FloatArray
) -> None:
    """Refuse the first joint that is wrong, by its name; its figures stand in `problem`."""
    for joint in np.flatnonzero(wrong):
        told = problem.format(*(f"{figure[joint]:.6g}" for figure in figures))
        raise BadProblemError(f"joint {names[int(joint)]}: {told}.")


class AccelerationBounds:
    """Bounds for n joints without allocating anything.

    Arrays are (n,), or one figure for all; rad, or m for prismatic joints.

    Args:
        lower, upper: limits of the position; ∓inf where there is none.
        velocity: greatest speed; inf where there is none.
        acceleration: greatest acceleration up, and down too unless `deceleration` is given.
        period_s: T, for which an acceleration is held [s].
        deceleration: greatest acceleration down, positive.
        horizon_s: T_b ≥ T: bounds that may be held for any time up to it. (k+1)·T survives k missed
            ticks, and gentle bounds rest at a wall where those for T chatter. None: T.
        brake_share: of the accelerations that stopping in time counts on, in (0, 1]. Less than 1
            where what is asked for is not quite what is done.
        softness: how far beyond its range a joint may come to be that is drawn back gently, and not
            thrown back with all it has [rad or m]. 0 where what is asked for is done exactly.
        shrink: where the limits violate condition (11), lower the accelerations to what satisfies
            it, instead of raising.
        naive: for `solve_naive` only, which takes limits that violate (11), too.
        names: of the joints, for errors.

    Attributes:
        n: number of joints.
        up, down: (n,) greatest accelerations that are in use, after shrinking.

    Raises:
        BadProblemError: limits that contradict each other or, unless `naive`, violate (11) with
            T_b. (11) is both necessary and sufficient for bounds to exist in every state from
            which a joint can stop: speed ≥ T·max(up, down), and the range must hold the way of two
            opposite steps.
    """

    def __init__(
        self,
        lower: ArrayLike,
        upper: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        period_s: float,
        *,
        deceleration: ArrayLike | None = None,
        horizon_s: float | None = None,
        brake_share: float = 1.0,
        softness: float = 0.0,
        shrink: bool = False,
        naive: bool = False,
        names: Iterable[str] = (),
    ) -> None:
        from hoap3.protocol.limits import viability_bounds_kernels as kernels

        down = acceleration if deceleration is None else deceleration
        given = (lower, upper, velocity, acceleration, down)
        try:
            rows = np.broadcast_arrays(*(np.atleast_1d(np.asarray(row, float)) for row in given))
        except ValueError as error:
            raise BadProblemError(f"limits must be numbers, one a joint: {error}.") from error
        if rows[0].ndim != 1:
            raise BadProblemError(f"limits have shape {rows[0].shape}; give one figure a joint.")
        self.n = rows[0].size
        self._names = tuple(names) or tuple(str(joint) for joint in range(self.n))
        self._limits = np.vstack([*rows, np.zeros(self.n)])
        self.up, self.down = self._limits[3], self._limits[4]
        self._held = period_s if horizon_s is None else horizon_s
        if not (0.0 < period_s <= self._held < np.inf):
            raise BadProblemError(
                f"period {period_s} s and horizon {self._held} s: both must be positive, and the "
                "horizon no shorter than the period."
            )
        if not 0.0 < brake_share <= 1.0:
            raise BadProblemError(f"brake share {brake_share}: it must be in (0, 1].")
        if not 0.0 <= softness < np.inf:
            raise BadProblemError(f"softness {softness}: it must be finite, and not negative.")
        self._share, self._softness = brake_share, softness
        self._check_limits()
        if shrink:
            self._shrink()
        self._only_naive = naive
        if not naive:
            self._check_condition()
        ends = np.abs(self._limits[:2])
        self._limits[5] = np.where(np.isfinite(ends), ends, 0.0).max(axis=0)
        self._kernel, self._naive = kernels.acceleration_bounds_kernel, kernels.naive_bounds_kernel

    def limit_speed(self, velocity: FloatArray) -> None:
        """Take other greatest speeds, (n,), that satisfy (11) as those before did."""
        self._limits[2] = velocity

    def solve(
        self, q: FloatArray, dq: FloatArray, lower_out: FloatArray, upper_out: FloatArray
    ) -> None:
        """Write the bounds; lower ≤ upper always.

        Outside a limit, or too fast to stop before it, the bounds meet at what leads back soonest.

        Args:
            q, dq: (n,) positions and velocities.
            lower_out, upper_out: (n,) [rad/s² or m/s²]; untouched on an error.

        Raises:
            BadProblemError: q or dq is not finite, or an array of the wrong type or shape; or
                these are `naive` bounds, whose limits were not checked for (11).
        """
        if self._only_naive:
            raise BadProblemError("naive bounds have no solve: call solve_naive.")
        limits = self._limits, self._held, self._share, self._softness
        try:
            status, joint = self._kernel(q, dq, *limits, lower_out, upper_out)
        except TypeError as error:
            raise self._wrong_arrays() from error
        if status:
            self._explain(joint, q, dq)

    def solve_naive(
        self, q: FloatArray, dq: FloatArray, lower_out: FloatArray, upper_out: FloatArray
    ) -> None:
        """As `solve`, but by (2): to compare with, for it does not keep the limits.

        Where the bounds cross, as they may where (11) is violated, they meet at the upper one.
        """
        try:
            status, joint = self._naive(q, dq, self._limits, self._held, lower_out, upper_out)
        except TypeError as error:
            raise self._wrong_arrays() from error
        if status:
            self._explain(joint, q, dq)

    def _wrong_arrays(self) -> BadProblemError:
        wanted = f"contiguous float64 arrays of {self.n} joints"
        return BadProblemError(f"q, dq and the outputs must be {wanted}.")

    def _explain(self, joint: int, q: FloatArray, dq: FloatArray) -> NoReturn:
        """Raise what a kernel found wrong."""
        if joint < 0:
            raise self._wrong_arrays()
        raise BadProblemError(
            f"joint {self._names[joint]}: q = {q[joint]} and dq = {dq[joint]} must be finite."
        )

    def _check_limits(self) -> None:
        lower, upper, velocity, up, down = self._limits[:5]
        self._refuse(~(lower < upper), "position limits {0} to {1} leave no room", lower, upper)
        self._refuse(~(velocity > 0.0), "greatest speed {0} must be positive", velocity)
        for limit in (up, down):
            self._refuse(~(limit > 0.0), "greatest acceleration {0} must be positive", limit)

    def _check_condition(self) -> None:
        """(11), for limits that may differ up and down."""
        lower, upper, velocity, up, down = self._limits[:5]
        fast, slow = np.maximum(up, down), self._share * np.minimum(up, down)
        free = np.isinf(velocity) & np.isinf(upper - lower)
        needed = np.where(free, 0.0, self._held * fast)
        violated = "(11) is violated: {} is less than {}; " + _SHRINK
        problem = violated.format("speed {0}", "T·A = {1}")
        self._refuse(velocity < needed * (1.0 - 1e-12), problem, velocity, needed)
        with np.errstate(invalid="ignore"):
            way = 0.5 * self._held**2 * fast * (1.0 + fast / slow)
        way = np.where(np.isinf(upper - lower), 0.0, way)
        problem = violated.format("the range {0}", "{1}")
        self._refuse(~(upper - lower >= way * (1.0 - 1e-12)), problem, upper - lower, way)

    def _shrink(self) -> None:
        lower, upper, velocity, up, down = self._limits[:5]
        span, T = self._share * (upper - lower), self._held  # less than (11) asks for
        cap = np.minimum(velocity / T, span / T**2)
        slow = np.minimum(np.minimum(up, down), cap)
        with np.errstate(invalid="ignore", over="ignore"):
            fast = 0.5 * slow * (np.sqrt(1.0 + 8.0 * span / (T**2 * slow)) - 1.0)
        fast = np.where(np.isinf(slow) | np.isinf(span), np.inf, fast)
        fast = np.minimum(np.minimum(np.maximum(up, down), velocity / T), np.maximum(fast, slow))
        up_is_slow = up <= down
        self.up[:], self.down[:] = np.where(up_is_slow, (slow, fast), (fast, slow))

    def _refuse(self, wrong: NDArray[np.bool_], problem: str, *figures: FloatArray) -> None:
        refuse_joint(wrong, self._names, problem, *figures)


def acceleration_bounds(
    q: ArrayLike,
    dq: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    period_s: float,
    *,
    deceleration: ArrayLike | None = None,
    horizon_s: float | None = None,
    shrink: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest acceleration of each joint; see `AccelerationBounds`.

    Returns:
        Lower and upper bounds, (n,) [rad/s² or m/s²].

    Raises:
        BadProblemError: as `AccelerationBounds` and its `solve`.
    """
    try:
        position, speed = np.atleast_1d(np.array(q, float)), np.atleast_1d(np.array(dq, float))
        least, most = (
            np.broadcast_to(np.asarray(end, float), position.shape) for end in (lower, upper)
        )
    except ValueError as error:
        raise BadProblemError(f"q, dq and limits must be numbers, one a joint: {error}.") from error
    bounds = AccelerationBounds(
        least,
        most,
        velocity,
        acceleration,
        period_s,
        deceleration=deceleration,
        horizon_s=horizon_s,
        shrink=shrink,
    )
    lower_out, upper_out = np.empty(bounds.n), np.empty(bounds.n)
    bounds.solve(position, speed, lower_out, upper_out)
    return lower_out, upper_out
