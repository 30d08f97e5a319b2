"""The priorities of tasks: settings, matrix, timeline and live changes.

alpha_ij is the priority of task j over task i, (4) and (11) of Liu, Tan and Padois (2015): 1 keeps
i out of j's directions, 0 lets it in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import ConfigError, one_of
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.scheduling.schedule import Schedule, Seconds

Alpha = Annotated[float, Field(strict=True, ge=0, le=1)]
Entry = tuple[str, str, Alpha]
Few = Field(max_length=100, fail_fast=True)  # the network may send anything; the tick is 1 ms
Level = Annotated[tuple[str, ...], Few]
Order = Annotated[tuple[str | Level, ...], Few]
Names = str | Level
Entries = tuple[tuple[int, int, float], ...]


class ChangeRequest(Settings):
    """One change of priorities: one of set, order, insert and remove."""

    over_s: Seconds = Field(0.0, description="duration of the transition, (15) [s]; 0: at once")
    set: Annotated[tuple[Entry, ...], Few] = Field(
        (), description="[A, B, alpha]: how much A is kept out of B; B out of A becomes 1 − alpha"
    )
    order: Order = Field((), description="tasks, highest first; the pairs among them change")
    insert: Names = Field((), description="tasks that take part again, with their priorities")
    remove: Names = Field((), description="tasks that no longer take part")

    @model_validator(mode="after")
    def _one_change(self) -> Self:
        if sum(map(bool, (self.set, self.order, self.insert, self.remove))) != 1:
            raise ValueError("should have one of set, order, insert and remove")
        if self.order and sum(1 if isinstance(each, str) else len(each) for each in self.order) < 2:
            raise ValueError("should order two tasks or more")
        return self


class ChangeSettings(ChangeRequest):
    """A change of the timeline."""

    at_s: Seconds = Field(description="its begin, since the controller's [s]")


class PrioritySettings(Settings):
    """Priorities at the start, by `order` or by `matrix`, and how they change."""

    order: Order = Field(
        (), description="all tasks, highest first; those of an inner list at one level"
    )
    matrix: tuple[tuple[Alpha, ...], ...] = Field(
        (), description="instead: row i, column j: priority of task j over task i, 0 to 1"
    )
    inactive: tuple[str, ...] = Field((), description="tasks that take no part at the start")
    timeline: tuple[ChangeSettings, ...] = Field(
        (), description="changes, in any order; those of one pair may not overlap"
    )

    @model_validator(mode="after")
    def _one_start(self) -> Self:
        if self.order and self.matrix:
            raise ValueError("should have either order or matrix")
        if self.order == () and "order" in self.model_fields_set:
            raise ValueError("should name every task in order, or have no order")
        return self


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


class Priorities(Schedule):
    """A matrix of priorities that moves smoothly.

    alpha_ij is the priority of task j over task i (Liu, Tan and Padois 2015, (4) and (11)): 1 keeps
    i out of j's directions. Cycles are allowed. What is set is remembered for tasks that take no
    part, and holds when they are inserted.

    Args:
        names: of the tasks, each another one, in the order of rows and columns.
        settings: as a config has them.

    Attributes:
        alpha: (k, k) at the time of the last `update`; the same memory for ever.

    Raises:
        ConfigError: a matrix of another size, an unknown task, one that is named twice, or changes
            of the timeline that contradict each other.
    """

    key, request = "priorities", ChangeRequest

    def __init__(self, names: Sequence[str], settings: PrioritySettings) -> None:
        start = start_matrix(names, settings)
        self._inactive = list(places(settings.inactive, names, "inactive"))
        self._wanted, self._former = start.copy(), start.copy()
        self._out = np.zeros(len(names), bool)
        super().__init__(names, start, settings.timeline)
        self.alpha = self._transition.value

    def _begin(self) -> None:
        self._wanted[:] = self._start
        self._out[:] = False
        self._out[self._inactive] = True
        without(self._wanted, self._out, self._goal)

    def change(self, request: Mapping[str, Any], time_s: float) -> None:
        """Begin a change that the timeline does not have; `alpha` is as it begins at once.

        Args:
            request: one of `set`: [[A, B, alpha], ...], `order`, `insert` and `remove`, with
                `over_s` [s], as in a timeline.
            time_s: now, since the reset [s].

        Raises:
            ConfigError: something is wrong with it; nothing has been changed then.
        """
        super().change(request, time_s)
        self._advance(time_s)

    def _asked(self, request: ChangeRequest, time_s: float) -> Change:
        names = self.names
        entries = *set_entries(request.set, names), *order_entries(request.order, names)
        inserted = places(request.insert, names, "insert")
        removed = places(request.remove, names, "remove")
        for i in inserted:
            if not self._out[i]:
                problem, remedy = "takes part already", "Insert what was removed, or is `inactive`"
                raise ConfigError("", "insert", names[i], problem, remedy)
        for i in removed:
            if self._out[i]:
                raise ConfigError("", "remove", names[i], "takes no part", "Remove what takes part")
        return Change(time_s, request.over_s, entries, inserted, removed)

    def _shared(self, earlier: Change, later: Change) -> str:
        shared = earlier.pairs(len(self.names)) & later.pairs(len(self.names))
        if not shared:
            return ""
        i, j = min(shared)
        return f"the priorities of {self.names[i]} and {self.names[j]}"

    def shown(self) -> dict[str, Any]:
        """Names, alpha row by row, whether it moves, and tasks that are out, as a JSON object."""
        out = [name for name, left in zip(self.names, self._out, strict=True) if left]
        rows = self.alpha.tolist()
        return {"names": list(self.names), "alpha": rows, "moving": self.moving, "out": out}

    def _set_out(self, change: Change) -> None:
        """Send those entries on their way whose goal another one is, or that are asked for.

        A pair with a task that takes no part is only remembered.
        """
        out = self._out
        self._former[:] = self._goal
        write(change.entries, self._wanted)
        out[list(change.inserted)] = False
        out[list(change.removed)] = True
        without(self._wanted, out, self._goal)
        which = self._goal != self._former
        for i, j, _ in change.entries:
            which[i, j] |= not (out[i] or out[j])
        self._transition.head(self._goal, which, change.at_s, change.over_s)


def place(name: str, names: Sequence[str], key: str) -> int:
    """Where a task stands among `names`.

    Raises:
        ConfigError: none is called so.
    """
    if name in names:
        return names.index(name)
    remedy = one_of(name, names, "Tasks")
    raise ConfigError("", key, name, "no task is called so", remedy)


def places(given: Names, names: Sequence[str], key: str) -> tuple[int, ...]:
    """Where tasks stand among `names`, each of them once.

    Raises:
        ConfigError: an unknown one, or one that is named twice.
    """
    listed = (given,) if isinstance(given, str) else given
    found = dict.fromkeys(place(name, names, key) for name in listed)
    if len(found) < len(listed):
        twice = next(name for name in names if listed.count(name) > 1)
        raise ConfigError("", key, twice, "this task is named twice", "Name it once")
    return tuple(found)


def order_entries(order: Order, names: Sequence[str]) -> Entries:
    """Entries of the pairs among the tasks of an order, (i, j, alpha_ij).

    Raises:
        ConfigError: an unknown task, or one that is named twice.
    """
    levels = [(level,) if isinstance(level, str) else level for level in order]
    levels_of = [rank for rank, level in enumerate(levels) for _ in level]
    named = tuple(name for level in levels for name in level)
    ranks = dict(zip(places(named, names, "order"), levels_of, strict=True))
    return tuple((i, j, float(ranks[j] < ranks[i])) for i in ranks for j in ranks if i != j)


def set_entries(given: Sequence[Entry], names: Sequence[str]) -> Entries:
    """Entries of [A, B, alpha] and, where they are not given themselves, of B and A, 1 − alpha.

    Raises:
        ConfigError: an unknown task, or a pair that is set twice.
    """
    found: dict[tuple[int, int], float] = {}
    for number, (a, b, value) in enumerate(given):
        i, j = (place(name, names, f"set.{number}") for name in (a, b))
        if (i, j) in found:
            problem, remedy = "this pair is set twice", "Leave one of them out"
            raise ConfigError("", f"set.{number}", [a, b, value], problem, remedy)
        found[i, j] = value
    partners = {(j, i): 1.0 - value for (i, j), value in found.items() if i != j}
    return tuple((i, j, value) for (i, j), value in {**partners, **found}.items())


def start_matrix(names: Sequence[str], settings: PrioritySettings) -> FloatArray:
    """Priorities of a config, (k, k); zeros where it names none.

    Raises:
        ConfigError: an order that leaves a task out, or a matrix of another size.
    """
    k, rows = len(names), settings.matrix
    alpha = np.zeros((k, k))
    if rows:
        if len(rows) != k or any(len(row) != k for row in rows):
            size = f"{len(rows)} rows of {'/'.join(sorted({str(len(row)) for row in rows}))}"
            problem = f"has {size} numbers for {k} tasks"
            remedy = f"Give it {k} rows of {k}, in the order of the tasks: {', '.join(names)}"
            raise ConfigError("", "matrix", None, problem, remedy)
        alpha[:] = rows
    elif settings.order:
        entries = order_entries(settings.order, names)
        levels = [(level,) if isinstance(level, str) else level for level in settings.order]
        missing = [name for name in names if not any(name in level for level in levels)]
        if missing:
            problem, remedy = f"leaves out {', '.join(missing)}", "Name every task"
            raise ConfigError("", "order", settings.order, problem, remedy)
        write(entries, alpha)
    return alpha


def distinct(names: Sequence[str]) -> list[str]:
    """Names of the tasks of a config.

    Raises:
        ConfigError: two of them are the same.
    """
    for number, name in enumerate(names):
        if name in names[:number]:
            problem, remedy = "two tasks have this name", "Give this one another"
            raise ConfigError("", f"tasks.{number}.name", name, problem, remedy)
    return [*names]


def write(entries: Entries, alpha: FloatArray) -> None:
    """Set entries of a matrix."""
    for i, j, value in entries:
        alpha[i, j] = value


def without(alpha: FloatArray, out: NDArray[np.bool_], result: FloatArray) -> None:
    """Write into `result` what is left of priorities (k, k) without the tasks that are `out`, (k,).

    Their columns are 0: they restrict no other task. Their rows are 1, also on the diagonal: every
    task restricts them, themselves included, so they contribute nothing.
    """
    result[:] = alpha
    result[:, out] = 0.0
    result[out] = 1.0


def top_level(alpha: FloatArray) -> NDArray[np.bool_]:
    """Active tasks that no other task restricts, (k,); all active ones where there is none."""
    present = np.diag(alpha) < 1.0
    others = alpha.copy()
    np.fill_diagonal(others, 0.0)
    top = present & ~others.any(axis=1)
    return top if top.any() else present
