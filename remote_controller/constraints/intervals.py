"""Intervals of joint velocities."""

from __future__ import annotations

import numpy as np

from protocol.messages import FloatArray


def narrow(
    lower_out: FloatArray, upper_out: FloatArray, lower: FloatArray, upper: FloatArray
) -> None:
    """Cut intervals down to others; of two that do not meet, the nearest value of the first stays.

    Args:
        lower_out, upper_out: (n,) the intervals, changed in place.
        lower, upper: (n,) the others, overwritten.
    """
    np.clip(lower, lower_out, upper_out, out=lower)
    np.clip(upper, lower_out, upper_out, out=upper)
    lower_out[:], upper_out[:] = lower, upper
