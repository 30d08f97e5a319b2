"""Numbers of tasks that follow a timeline and live changes, and checked changes of priorities."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from hoap3.protocol.config.settings import Settings, parse
from hoap3.protocol.errors import ConfigError, located
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.scheduling.numbers import FILE
from hoap3.remote_controller.scheduling.priority_matrix import (
    Entries,
    order_entries,
    places,
    set_entries,
)
from hoap3.remote_controller.scheduling.settings import ChangeRequest, PrioritySettings
from hoap3.remote_controller.scheduling.transition import Transition


class Schedule(ABC):
    """Numbers that begin somewhere, and move smoothly from change to change.

    A change begins with the values of its moment, so that the numbers are continuous unless it is
    to be made at once. Time is that since the controller began, from the robot's ticks, and does
    not go back. To be called from one thread.

    Args:
        names: of the tasks.
        start: the numbers, of the shape that they have.
        timeline: changes by their time; each has `at_s` and `over_s`.

    Attributes:
        names: of the tasks.
        moving: whether a transition is under way.
    """

    live: ClassVar[str]
    """What errors call a change that comes while the robot moves."""
    request: ClassVar[type[Settings]]
    """Its settings."""

    def __init__(self, names: Sequence[str], start: FloatArray, timeline: Sequence[Any]) -> None:
        self.names, self._timeline = tuple(names), (*timeline,)
        self._start, self._goal = start.copy(), start.copy()
        self._transition = Transition(start)
        self.reset()

    @abstractmethod
    def _begin(self) -> None:
        """Write the numbers of the start into `_goal`."""

    @abstractmethod
    def _asked(self, request: Any, time_s: float) -> Any:
        """A parsed request as a change that begins now; refuses what does not fit the tasks."""

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
                problem = f"does not go together with a {cls.live}"
                remedy = "Each kind is changed at a time of its own: send two changes"
                raise ConfigError(FILE, str(key), value, problem, remedy)

    @abstractmethod
    def shown(self) -> dict[str, Any]:
        """What it is now, for people."""

    def reset(self) -> None:
        """Go back to the start and its timeline; live changes are forgotten."""
        self._begin()
        self._transition.rest(self._goal)
        self._next, self._changed, self.moving = 0, False, False
        self._next_at = self._timeline[0].at_s if self._timeline else math.inf

    def update(self, time_s: float) -> bool:
        """Recompute the numbers for a time since the reset [s]; whether they are others."""
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
        asked = parse(self.request, content, self.live)
        self._advance(time_s)
        with located(self.live):
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


@dataclass(frozen=True)
class Change:
    """A change of priorities.

    Attributes:
        at_s, over_s: begin and duration [s].
        entries: (i, j, alpha_ij) that are set.
        inserted, removed: tasks.
    """

    at_s: float
    over_s: float
    entries: Entries
    inserted: tuple[int, ...]
    removed: tuple[int, ...]

    def pairs(self, k: int) -> frozenset[tuple[int, int]]:
        """Pairs of the k tasks that it concerns, the lower number first."""
        whole = {(i, j) for i in (*self.inserted, *self.removed) for j in range(k)}
        return frozenset((min(i, j), max(i, j)) for i, j in {e[:2] for e in self.entries} | whole)


def change_of(
    request: ChangeRequest, names: Sequence[str], out: Collection[int], at_s: float
) -> Change:
    """A request, with numbers for the names.

    Args:
        request: what is asked for.
        names: of the tasks.
        out: tasks that take no part before it.
        at_s: its begin [s].

    Raises:
        ConfigError: an unknown task, one that is named twice, a pair that is set twice, or a task
            that is to be inserted and takes part already, or removed and does not.
    """
    entries = *set_entries(request.set, names), *order_entries(request.order, names)
    inserted = places(request.insert, names, "insert")
    removed = places(request.remove, names, "remove")
    for i in inserted:
        if i not in out:
            problem, remedy = "takes part already", "Insert what was removed, or is `inactive`"
            raise ConfigError("", "insert", names[i], problem, remedy)
    for i in removed:
        if i in out:
            raise ConfigError("", "remove", names[i], "takes no part", "Remove what takes part")
    return Change(at_s, request.over_s, entries, inserted, removed)


def timeline_of(settings: PrioritySettings, names: Sequence[str]) -> tuple[Change, ...]:
    """The changes of a config by their time.

    Raises:
        ConfigError: see `change_of`; or two changes of one pair that overlap in time.
    """
    given = sorted(enumerate(settings.timeline), key=lambda item: item[1].at_s)
    out = set(places(settings.inactive, names, "inactive"))
    changes: list[Change] = []
    for number, request in given:
        with located("", f"timeline.{number}"):
            change = change_of(request, names, out, request.at_s)
            for (other, _), earlier in zip(given, changes, strict=False):
                shared = earlier.pairs(len(names)) & change.pairs(len(names))
                i, j = min(shared, default=(0, 0))
                about = f"the priorities of {names[i]} and {names[j]}" if shared else ""
                check_apart(other, earlier, change, about)
        out = (out | {*change.removed}) - {*change.inserted}
        changes.append(change)
    return tuple(changes)


def check_apart(other: int, earlier: Any, later: Any, about: str) -> None:
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
