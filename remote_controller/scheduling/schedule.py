"""Numbers of tasks that follow a timeline and live changes."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Container, Mapping, Sequence
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hoap3.protocol.config.settings import Settings, parse
from hoap3.protocol.errors import ConfigError, located
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.scheduling.changes import FILE

Seconds = Annotated[float, Field(strict=True, ge=0)]


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


class Schedule(ABC):
    """Numbers that begin somewhere, and move smoothly from change to change.

    A change begins with the values of its moment, so that the numbers are continuous unless it is
    to be made at once. Time is that since the controller began, from the robot's ticks, and does
    not go back. To be called from one thread.

    Args:
        names: of the tasks.
        start: the numbers, of the shape that they have.
        timeline: requests in any order; each has `at_s` and `over_s`.

    Attributes:
        names: of the tasks.
        moving: whether a transition is under way.
        time_s: of the last `update` [s].

    Raises:
        ConfigError: a request of the timeline does not fit the tasks, or overlaps another one of
            the same numbers in time.
    """

    key: ClassVar[str]
    """What the numbers are called: "priorities" or "weights"."""
    request: ClassVar[type[Settings]]
    """Its settings."""

    def __init__(self, names: Sequence[str], start: FloatArray, timeline: Sequence[Any]) -> None:
        self.names = tuple(names)
        self._start, self._goal = start.copy(), start.copy()
        self._transition = Transition(start)
        self._begin()
        self._timeline: list[Any] = []
        given = sorted(enumerate(timeline), key=lambda item: item[1].at_s)
        for number, request in given:
            with located("", f"timeline.{number}"):
                change = self._asked(request, request.at_s)
                for (other, _), earlier in zip(given, self._timeline, strict=False):
                    _check_apart(other, earlier, change, self._shared(earlier, change))
            self._set_out(change)
            self._timeline.append(change)
        self.reset()

    @abstractmethod
    def _begin(self) -> None:
        """Write the numbers of the start into `_goal`."""

    @abstractmethod
    def _asked(self, request: Any, time_s: float) -> Any:
        """A parsed request as a change from a time on; refuses what does not fit the tasks."""

    @abstractmethod
    def _shared(self, earlier: Any, later: Any) -> str:
        """The numbers that two changes have in common, for errors; "" for none."""

    @abstractmethod
    def _set_out(self, change: Any) -> None:
        """Send on their way those numbers that a change is about."""

    @classmethod
    def is_asked(cls, request: Mapping[str, Any]) -> bool:
        """Whether a request is for such a change, and not for one of other numbers."""
        return not cls.request.model_fields.keys().isdisjoint(request.keys() - {"over_s"})

    @classmethod
    def check_alone(cls, request: Mapping[str, Any], numbers: Container[str]) -> None:
        """Refuse a request that is for other numbers as well.

        Args:
            request: that is asked for such a change.
            numbers: first parts of the keys of all other numbers that may change.

        Raises:
            ConfigError: it names one of them.
        """
        for key, value in request.items():
            if str(key).split(".")[0] in numbers:
                problem = f"does not go together with a change of {cls.key}"
                remedy = "Each kind is changed at a time of its own: send two changes"
                raise ConfigError(FILE, str(key), value, problem, remedy)

    @abstractmethod
    def shown(self) -> dict[str, Any]:
        """What it is now, for people."""

    def reset(self) -> None:
        """Go back to the start and its timeline; live changes are forgotten."""
        self.time_s = 0.0
        self._begin()
        self._transition.rest(self._goal)
        self._next, self._changed, self.moving = 0, False, False
        self._next_at = self._timeline[0].at_s if self._timeline else math.inf

    def update(self, time_s: float) -> bool:
        """Recompute the numbers for a time since the reset [s]; whether they are others."""
        self.time_s = time_s
        if not (self.moving or self._changed) and time_s < self._next_at:
            return False
        self._advance(time_s)
        changed, self._changed = self._changed, False
        return changed

    def change(self, request: Mapping[str, Any], time_s: float) -> None:
        """Begin a change that the timeline does not have; the next `update` shows it.

        Args:
            request: as in a timeline, without `at_s`.
            time_s: now, since the reset [s].

        Raises:
            ConfigError: something is wrong with it; nothing has been changed then.
        """
        content = dict(request) if isinstance(request, Mapping) else request
        name = f"change of {self.key}"
        asked = parse(self.request, content, name)
        self._advance(time_s)
        with located(name):
            self._set_out(self._asked(asked, time_s))
        self.moving = True

    def _advance(self, time_s: float) -> None:
        """Follow the timeline up to a time, each change from its very begin."""
        while self._next_at <= time_s:
            self._changed |= self._transition.advance(self._next_at)
            self._set_out(self._timeline[self._next])
            self._next += 1
            left = self._next < len(self._timeline)
            self._next_at = self._timeline[self._next].at_s if left else math.inf
        self._changed |= self._transition.advance(time_s)
        self.moving = time_s < self._transition.end


def _check_apart(other: int, earlier: Any, later: Any, about: str) -> None:
    """Refuse two changes of the same, unless one is over when the other begins.

    Args:
        other: number of the earlier one in the timeline.
        earlier, later: both; each has `at_s` and `over_s`.
        about: what both change, in words; "" for nothing.

    Raises:
        ConfigError: they overlap.
    """
    end_s = earlier.at_s + earlier.over_s
    if not about or (later.at_s > earlier.at_s and later.at_s >= end_s):
        return
    problem = f"overlaps timeline.{other}, {earlier.at_s:g} s to {end_s:g} s, in {about}"
    remedy = f"Let one end before the other begins: at_s {max(end_s, later.at_s):g}"
    if end_s == later.at_s:
        remedy = "Make one change of both, or give them different times"
    raise ConfigError("", "at_s", later.at_s, problem, remedy)
