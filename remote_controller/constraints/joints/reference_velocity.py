"""How the reference of a robot really moved over the last period."""

from __future__ import annotations

import numpy as np

from hoap3.protocol.messages import FloatArray, State


class ReferenceVelocity:
    """Differences of the reference that a robot applies, over the ticks in between.

    Where none is known, at the first State after a reset, the State's dq.

    Args:
        n: number of joints.
        period_s: of a tick [s].
    """

    def __init__(self, n: int, period_s: float) -> None:
        self._velocity, self._before = np.zeros((2, n))
        self._period_s, self._tick, self._begun = period_s, 0, False

    def reset(self) -> None:
        """Forget the States so far."""
        self._begun = False

    def update(self, state: State) -> FloatArray:
        """Velocities of a State, (n,) [rad/s or m/s], in an array that the next one overwrites."""
        tick = int(state.tick) - int(state.skipped)
        periods = tick - self._tick
        if self._begun and periods == 0:
            return self._velocity
        if self._begun and periods > 0:
            np.subtract(state.reference, self._before, out=self._velocity)
            self._velocity /= periods * self._period_s
        else:
            self._velocity[:] = state.dq
            np.nan_to_num(self._velocity, copy=False, posinf=0.0, neginf=0.0)
        self._before[:], self._tick, self._begun = state.reference, tick, True
        return self._velocity
