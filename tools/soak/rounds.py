"""What was seen, round by round, in little memory: a day of it takes a few megabytes."""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping, Sequence

import numpy as np

from hoap3.tools.soak.trend import Series


class Rounds:
    """Figures by name, one value a round.

    Args:
        names: of the figures.
        label: whose they are, for people.
    """

    def __init__(self, names: Sequence[str], label: str = "") -> None:
        self.label = label
        self._times = array("d")
        self._columns = {name: array("d") for name in names}

    def add(self, time_s: float, figures: Mapping[str, float]) -> None:
        """A round; what `figures` does not have is no number in it."""
        self._times.append(time_s)
        for name, column in self._columns.items():
            column.append(figures.get(name, math.nan))

    def since(self, begin_s: float) -> dict[str, Series]:
        """Every figure from a time on, and `t`, the times of its rounds [s]."""
        times = np.array(self._times)
        there = times >= begin_s
        columns = {name: np.array(column)[there] for name, column in self._columns.items()}
        return {"t": times[there], **columns}
