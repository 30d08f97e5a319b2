"""Weights and priorities of tasks over time: start values, the timeline, and live changes.

Liu, Tan and Padois, Autonomous Robots 2015, (11) and (15). α_ij is the priority of task j over
task i. An inactive task has α_ij = 1 for all j, itself included, and α_ji = 0.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoap3.remote_controller.problems.oracles.parameters import (
    NOT_READ,
    UnverifiableError,
    reason_of,
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Settings = Mapping[str, Any]


class Schedule(ABC):
    """Values at each time since the reset [s], evaluated in ascending order of time.

    Args:
        names: of the tasks.
        start: the values, of any shape.
        events: changes of the timeline; each has `at_s`.
    """

    def __init__(self, names: Sequence[str], start: Array, events: Sequence[Settings]) -> None:
        self.names, self._later = list(names), sorted(events, key=lambda event: event["at_s"])
        self.goal = start.copy()
        self._from, self._to = start.copy(), start.copy()
        self._begin, self._over = np.zeros(start.shape), np.zeros(start.shape)
        self._time = -math.inf

    @property
    def moving(self) -> bool:
        """Whether a value was in transition at the last evaluation, or will be."""
        return bool(self._later) or self._time < float((self._begin + self._over).max())

    @property
    def under_way(self) -> bool:
        """Whether a value was in transition at the last evaluation."""
        ends = self._begin + self._over
        return bool(((self._from != self._to) & (ends > self._time)).any())

    def at(self, time_s: float) -> Array:
        """Evaluate the values."""
        self._time = time_s
        while self._later and self._later[0]["at_s"] <= time_s:
            event = self._later.pop(0)
            self._take(event, event["at_s"])
        return self._value(time_s)

    def change(self, request: Settings, time_s: float) -> None:
        """Apply a request, at a time since the reset [s].

        Raises:
            UnverifiableError: it is none of these tasks.
        """
        self.at(time_s)
        try:
            self._take(request, time_s)
        except NOT_READ as error:
            raise UnverifiableError(reason_of(error)) from error
        self._time = -math.inf

    @abstractmethod
    def retarget(self, event: Settings) -> Flags:
        """Write the goals of an event into `goal`; return which values start a transition."""

    def _take(self, event: Settings, time_s: float) -> None:
        present = self._value(time_s)
        which = self.retarget(event)
        self._from[which], self._to[which] = present[which], self.goal[which]
        self._begin[which], self._over[which] = time_s, event.get("over_s", 0.0)

    def _value(self, time_s: float) -> Array:
        """(15): half a cosine from the earlier value to the goal."""
        done = np.clip((time_s - self._begin) / np.where(self._over > 0.0, self._over, 1.0), 0, 1)
        way = (0.5 - 0.5 * np.cos(np.pi * done)) * (self._to - self._from)
        arrived = time_s >= self._begin + self._over
        return np.where(arrived, self._to, self._from + way)


class TickSchedule:
    """A schedule at the ticks of a run.

    Values are settled one tick ahead, so that a certificate covers the next period too: a request
    that comes between two States takes effect after the second.

    Args:
        schedule: at its start.
        period_s: of a tick [s].

    Attributes:
        values: at the newest tick.
        moves: whether they differ from those of the next tick.
    """

    def __init__(self, schedule: Schedule, period_s: float) -> None:
        self._schedule, self._period_s, self._settled = schedule, period_s, 0
        self.values = self._next = schedule.at(0.0)
        self.moves = False

    def change(self, request: Settings) -> None:
        """Apply a request."""
        self._schedule.change(request, self._settled * self._period_s)

    def advance(self, tick: int) -> None:
        """Evaluate a tick since the reset, and the one after it."""
        schedule = self._schedule
        self.values = schedule.at(tick * self._period_s) if tick > self._settled else self._next
        self._settled = tick + 1
        moving = schedule.moving
        self._next = schedule.at(self._settled * self._period_s) if moving else self.values
        self.moves = bool((self.values != self._next).any())


class Weights(Schedule):
    """ω_i of each task, (k,); by default 1."""

    def __init__(self, names: Sequence[str], settings: Settings) -> None:
        given = settings.get("weights") or {}
        start = np.array([float(given.get(name, 1.0)) for name in names])
        super().__init__(names, start, settings.get("timeline") or ())

    def retarget(self, event: Settings) -> Flags:
        """Retarget the weights that an event names."""
        for name, weight in event["weights"].items():
            self.goal[self.names.index(name)] = weight
        return np.array([name in event["weights"] for name in self.names])


class Priorities(Schedule):
    """α, (k, k)."""

    def __init__(self, names: Sequence[str], settings: Settings) -> None:
        k, names = len(names), list(names)
        self._wanted = np.zeros((k, k))
        if settings.get("matrix"):
            self._wanted = np.array(settings["matrix"], float)
            if self._wanted.shape != (k, k) or not (abs(self._wanted - 0.5) <= 0.5).all():
                raise UnverifiableError("the matrix of priorities cannot be read")
        elif settings.get("order"):
            for i, j, value in _ordered(settings["order"], names):
                self._wanted[i, j] = value
        self._out = np.zeros(k, bool)
        self._out[_places(settings.get("inactive") or (), names)] = True
        super().__init__(names, self._without(), settings.get("timeline") or ())

    def retarget(self, event: Settings) -> Flags:
        """Retarget what changes, and the pairs of active tasks that an event names."""
        entries = [*_set(event.get("set") or (), self.names)]
        entries += _ordered(event.get("order") or (), self.names)
        for i, j, value in entries:
            self._wanted[i, j] = value
        self._out[_places(event.get("insert") or (), self.names)] = False
        self._out[_places(event.get("remove") or (), self.names)] = True
        before, self.goal = self.goal, self._without()
        which = np.asarray(self.goal != before)
        for i, j, _ in entries:
            which[i, j] |= not (self._out[i] or self._out[j])
        return which

    def _without(self) -> Array:
        found = self._wanted.copy()
        found[:, self._out], found[self._out, :] = 0.0, 1.0
        return found


def top_tasks(alpha: Array) -> Flags:
    """Return which tasks are active and below no other, (k,); all active ones if there is none."""
    part = alpha.diagonal() < 1.0
    is_below = (alpha - np.diag(alpha.diagonal())).any(1)
    first = part & ~is_below
    return first if first.any() else part


def _places(given: str | Sequence[str], names: Sequence[str]) -> list[int]:
    return [names.index(name) for name in ([given] if isinstance(given, str) else given)]


def _ordered(order: Sequence[Any], names: Sequence[str]) -> list[tuple[int, int, float]]:
    """Return α of every pair among the tasks of an order: 1 over lower tasks."""
    ranks = {i: rank for rank, level in enumerate(order) for i in _places(level, names)}
    return [(i, j, float(ranks[j] < ranks[i])) for i in ranks for j in ranks if i != j]


def _set(given: Sequence[Any], names: Sequence[str]) -> list[tuple[int, int, float]]:
    """Return [A, B, α] and, of pairs that are not given both ways, [B, A, 1 − α]."""
    found = {(names.index(a), names.index(b)): float(value) for a, b, value in given}
    other = {(j, i): 1.0 - value for (i, j), value in found.items() if i != j}
    return [(i, j, value) for (i, j), value in {**other, **found}.items()]
