"""Numbers that move smoothly to where they shall be, each in its own time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.messages import FloatArray


class Transition:
    """A matrix, each entry of which is at rest or on its way from one value to another.

    On the way it follows (15) of Liu, Tan and Padois (2015), between any two values:

        a(t) = a_1 + (a_2 − a_1)·(0.5 − 0.5 cos(π(t − t_1)/(t_2 − t_1))),  t_1 ≤ t ≤ t_2

    Args:
        value: (k, k), where they begin.

    Attributes:
        value: (k, k), at the time of the last `advance`; the same memory for ever.
        end: when the last of them arrives [s].
    """

    def __init__(self, value: FloatArray) -> None:
        self.value = value.copy()
        self._start, self._goal, self._before = value.copy(), value.copy(), value.copy()
        self._share, self._begin, self._over, self._end = np.zeros((4, *value.shape))
        self._arrived = np.zeros(value.shape, bool)
        self.end = 0.0

    def rest(self, value: FloatArray) -> None:
        """Put all entries to rest at values, (k, k)."""
        self.value[:] = self._start[:] = self._goal[:] = value
        self._begin[:] = self._end[:] = 0.0
        self._over[:] = 1.0
        self.end = 0.0

    def head(
        self, goal: FloatArray, which: NDArray[np.bool_], time_s: float, over_s: float
    ) -> None:
        """Send entries from where they are to a goal.

        Args:
            goal: (k, k).
            which: (k, k), entries that set out.
            time_s: now [s], that of the last `advance`.
            over_s: duration [s]; 0: at once.
        """
        np.copyto(self._start, self.value, where=which)
        np.copyto(self._goal, goal, where=which)
        np.copyto(self._begin, time_s, where=which)
        np.copyto(self._over, over_s or 1.0, where=which)
        np.copyto(self._end, time_s + over_s, where=which)
        self.end = float(self._end.max(initial=0.0, where=self._start != self._goal))

    def advance(self, time_s: float) -> bool:
        """Write `value` for a time [s]; whether it is another than before."""
        share, value = self._share, self.value
        self._before[:] = value
        np.subtract(time_s, self._begin, out=share)
        np.divide(share, self._over, out=share)
        np.clip(share, 0.0, 1.0, out=share)
        np.multiply(share, np.pi, out=share)
        np.cos(share, out=share)
        np.multiply(share, -0.5, out=share)
        np.add(share, 0.5, out=share)
        np.subtract(self._goal, self._start, out=value)
        np.multiply(value, share, out=value)
        np.add(value, self._start, out=value)
        np.greater_equal(time_s, self._end, out=self._arrived)
        np.copyto(value, self._goal, where=self._arrived)
        return not np.array_equal(value, self._before)
