"""One joint with the same limits either way, as Figs. 1 to 4 have it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.robot.viability_bounds import AccelerationBounds
from hoap3.tools.reproduce.figures import Array


@dataclass(frozen=True)
class Joint:
    """Limits of a joint, and the periods of its controller.

    Attributes:
        end: q_max = −q_min [rad].
        speed: dq_max [rad/s].
        acceleration: ddq_max [rad/s²].
        period_s: δt [s].
    """

    end: float
    speed: float
    acceleration: float
    period_s: float

    def bounds(
        self, states: int, periods: float = 1.0, *, shrink: bool = False, naive: bool = False
    ) -> AccelerationBounds:
        """The shipped bounds, for many states of this joint at once.

        Args:
            states: how many.
            periods: T_b/δt.
            shrink: whether the acceleration may be lowered to what (11) asks for.
            naive: for `solve_naive` only.

        Raises:
            BadProblemError: (11) is violated, and they are not naive.
        """
        ends = np.full(states, self.end)
        return AccelerationBounds(
            -ends,
            ends,
            self.speed,
            self.acceleration,
            self.period_s,
            horizon_s=periods * self.period_s,
            shrink=shrink,
            naive=naive,
        )

    def viable(self, q: Array, dq: Array) -> NDArray[np.bool_]:
        """(8) to (10): fast, and yet able to stop before the limit, for feasible states."""
        room = np.where(dq > 0.0, self.end - q, self.end + q)
        return np.asarray(dq * dq <= 2.0 * self.acceleration * room)

    def reachable(self, q: Array, dq: Array) -> NDArray[np.bool_]:
        """Whether there is a way into a state from rest: out of its mirror image in time."""
        return self.viable(q, -dq)

    @property
    def stopping_speed(self) -> tuple[Array, Array]:
        """Positions from end to end, dense where it is steep, and dq_M of (8); both (401,)."""
        q = self.end * (1.0 - 2.0 * np.linspace(1.0, 0.0, 401) ** 2)
        return q, np.minimum(self.speed, np.sqrt(2.0 * self.acceleration * (self.end - q)))


FIG_1 = Joint(end=1.0, speed=5.0, acceleration=15.0, period_s=0.1)
"""The paper does not say δt, which the curves of others' methods depend on: 0.1 s is ours."""

FIG_3 = Joint(end=0.5, speed=2.0, acceleration=10.0, period_s=0.1)
FIG_4 = Joint(end=2.0, speed=2.0, acceleration=12.0, period_s=0.01)
