"""How fast something grows: a line through it, with bounds that allow for its own memory."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import t

CONFIDENCE = 0.95
STEEPEST = 2.0
HOUR_S = 3600.0

Series = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Trend:
    """A slope per hour, and what it is at least and at most, each with 95 % confidence.

    Of fewer than three values the bounds are infinite, and the slope is no number.
    """

    slope: float
    lower: float
    upper: float

    def as_json(self, unit: str) -> dict[str, float | None]:
        """The same by names that end in the unit; what is not finite is None."""
        named = {"slope": self.slope, "lower": self.lower, "upper": self.upper}
        return {
            f"{name}_{unit}": value if math.isfinite(value) else None
            for name, value in named.items()
        }


def block_means(times: Series, values: Series, length_s: float) -> tuple[Series, Series]:
    """Means over blocks of equal length.

    What is no number is left out, and so is a block of nothing else.

    Args:
        times: ascending [s].
        values: one at each of them.
        length_s: of a block, from the first time on [s].

    Returns:
        Mean time of each block [s], and the mean of its values.
    """
    known = np.isfinite(values)
    times, values = times[known], values[known]
    if not len(times):
        return times, values
    last = max(int((times[-1] - times[0]) / length_s + 0.5), 1) - 1  # of a piece, no block
    block = np.minimum(((times - times[0]) / length_s).astype(int), last)
    n = np.bincount(block)
    there = n > 0
    middles = np.bincount(block, times)[there] / n[there]
    above = np.bincount(block, values - values[0])[there] / n[there]  # 0, not nearly, of constants
    return middles, values[0] + above


def trend(times: Series, values: Series) -> Trend:
    """The least-squares slope of a series, with one-sided bounds.

    Values beside each other are alike: memory grows in steps, and stays. With the correlation r of
    a residual with the next one, at least 0, n values are worth n (1 − r)/(1 + r) independent
    ones, in the spread of the residuals as in the degrees of freedom of Student's t (Santer et al.
    2000, doi:10.1029/1999JD901105). Below one degree, where a series is of one piece, the bounds
    are ± `STEEPEST` times its whole range over its whole time: of a random walk, which keeps all
    that it ever took, and any slope added to it, that is exceeded in at most 5 % of cases.

    Args:
        times: equally far apart [s], (n,).
        values: at these times, (n,).
    """
    if len(times) < 3:
        return Trend(math.nan, -math.inf, math.inf)
    hours = (times - times.mean()) / HOUR_S
    spread = float(hours @ hours)
    values = values - values[0]  # or rounding would make a constant a series of one piece
    values -= values.mean()
    slope = float(hours @ values) / spread
    residuals = values - slope * hours
    square = float(residuals @ residuals)
    alike = max(float(residuals[1:] @ residuals[:-1]) / square, 0.0) if square else 0.0
    freedom = len(times) * (1.0 - alike) / (1.0 + alike) - 2.0
    if freedom < 1.0:
        steepest = STEEPEST * float(np.ptp(values) / np.ptp(hours))
        return Trend(slope, -steepest, steepest)
    margin = float(t.ppf(CONFIDENCE, freedom)) * math.sqrt(square / freedom / spread)
    return Trend(slope, slope - margin, slope + margin)
