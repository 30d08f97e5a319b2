"""Priorities of tasks over time, from a config, its timeline and live changes.

alpha_ij is the priority of task j over task i, (4) and (11) of Liu, Tan and Padois (2015). An entry
that is changed goes from a_1 to a_2 by (15), a_1 + (a_2 − a_1)(1 − cos π(t − t_1)/(t_2 − t_1))/2.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.tools.verify.constraints.parameters import UnverifiableError

Array = NDArray[np.float64]
Settings = Mapping[str, Any]
Entries = dict[tuple[int, int], float]


class Priorities:
    """The matrix at each time since the controller began.

    Args:
        names: of the tasks.
        given: `priorities` of the config.

    Attributes:
        alpha: (k, k) at the time of the last `at`.
        moving: whether an entry is on its way then.
        changed: whether any is another than at the `at` before.

    Raises:
        UnverifiableError: the config cannot be read.
    """

    def __init__(self, names: Sequence[str], given: Settings) -> None:
        self._names, k = list(names), len(names)
        try:
            matrix = given.get("matrix")
            start = np.array(matrix, float) if matrix else np.zeros((k, k))
            for place, value in self._ordered(given.get("order") or ()).items():
                start[place] = value
            if start.shape != (k, k) or not ((start >= 0.0) & (start <= 1.0)).all():
                raise UnverifiableError("the matrix of priorities cannot be read")
            self._start = start
            self._out_at_start = [self._place(name) for name in given.get("inactive") or ()]
            timeline = sorted(given.get("timeline") or (), key=lambda each: float(each["at_s"]))
            self._timeline = [(float(each["at_s"]), each) for each in timeline]
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise UnverifiableError(f"the priorities cannot be read: {error!r:.60}") from error
        self.begin()

    def begin(self) -> None:
        """Be as at the start, at time 0; live changes are forgotten."""
        k = len(self._names)
        self._wanted, self._out = self._start.copy(), np.zeros(k, bool)
        self._out[self._out_at_start] = True
        self._goal = self._left()
        self._from, self.alpha = self._goal.copy(), self._goal.copy()
        self._since, self._until = np.zeros((2, k, k))
        self._next, self._pending = 0, False
        self.moving = self.changed = False

    def at(self, time_s: float) -> None:
        """Be as at a time since the start [s], which is not before the last one."""
        self._advance(time_s)
        self.changed, self._pending = self._pending, False

    def change(self, request: Settings, time_s: float) -> None:
        """Begin a live change now, of the form of those in a timeline.

        Raises:
            UnverifiableError: it cannot be read.
        """
        self._advance(time_s)
        try:
            self._set_out(request, time_s)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise UnverifiableError(f"a change cannot be read: {error!r:.60}") from error
        self._advance(time_s)

    def _advance(self, time_s: float) -> None:
        while self._next < len(self._timeline) and self._timeline[self._next][0] <= time_s:
            begin, request = self._timeline[self._next]
            self._move(begin)
            self._set_out(request, begin)
            self._next += 1
        self._move(time_s)
        under_way = (self._from != self._goal) & (self._until > time_s)
        self.moving = bool(under_way.any())

    def _move(self, time_s: float) -> None:
        over = np.where(self._until > self._since, self._until - self._since, 1.0)
        share = np.clip((time_s - self._since) / over, 0.0, 1.0)
        on_the_way = self._from + (self._goal - self._from) * (0.5 - 0.5 * np.cos(np.pi * share))
        value = np.where(time_s >= self._until, self._goal, on_the_way)
        self._pending |= not np.array_equal(value, self.alpha)
        self.alpha = value

    def _set_out(self, request: Settings, time_s: float) -> None:
        """Send entries on their way from where they are."""
        entries = self._set(request.get("set") or ()) | self._ordered(request.get("order") or ())
        for place, value in entries.items():
            self._wanted[place] = value
        self._out[list(self._named(request.get("insert")))] = False
        self._out[list(self._named(request.get("remove")))] = True
        former, self._goal = self._goal, self._left()
        which = self._goal != former
        for i, j in entries:
            which[i, j] |= not (self._out[i] or self._out[j])
        self._from = np.where(which, self.alpha, self._from)
        self._since = np.where(which, time_s, self._since)
        self._until = np.where(which, time_s + float(request.get("over_s", 0.0)), self._until)

    def _left(self) -> Array:
        """What is wanted without the tasks that take no part: nobody heeds them, they heed all."""
        goal = self._wanted.copy()
        goal[:, self._out] = 0.0
        goal[self._out] = 1.0
        return goal

    def _ordered(self, order: Sequence[Any]) -> Entries:
        """Of the pairs in an order: 1 where the other one is on a level above."""
        levels = [[level] if isinstance(level, str) else list(level) for level in order]
        rank = {self._place(name): at for at, names in enumerate(levels) for name in names}
        return {(i, j): float(rank[j] < rank[i]) for i in rank for j in rank if i != j}

    def _set(self, given: Sequence[Any]) -> Entries:
        """Of [A, B, alpha]; the other way round it is 1 − alpha, unless that is given as well."""
        found = {(self._place(a), self._place(b)): float(value) for a, b, value in given}
        return {(j, i): 1.0 - value for (i, j), value in found.items() if i != j} | found

    def _named(self, names: Any) -> Iterator[int]:
        for name in [names] if isinstance(names, str) else names or ():
            yield self._place(name)

    def _place(self, name: str) -> int:
        return self._names.index(name)


def top_tasks(alpha: Array) -> NDArray[np.bool_]:
    """Which tasks take part and have none above, (k,); all that take part where there is none."""
    k = len(alpha)
    part = alpha.diagonal() < 1.0
    free = part & (np.where(np.eye(k, dtype=bool), 0.0, alpha) == 0.0).all(1)
    return free if free.any() else part
