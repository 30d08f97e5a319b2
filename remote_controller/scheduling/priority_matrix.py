"""Entries of the matrix of priorities, from names of tasks.

alpha_ij is the priority of task j over task i, (4) and (11) of Liu, Tan and Padois (2015): 1 keeps
i out of j's directions, 0 lets it in.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hoap3.protocol.errors import ConfigError, one_of
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.scheduling.settings import Entry, Names, Order, PrioritySettings

Entries = tuple[tuple[int, int, float], ...]


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

    Their columns are 0: nobody heeds them; their rows 1, with the diagonal: they heed everybody,
    also themselves, so that they do nothing.
    """
    result[:] = alpha
    result[:, out] = 0.0
    result[out] = 1.0


def top_level(alpha: FloatArray) -> NDArray[np.bool_]:
    """Which tasks take part and heed no other, (k,); in a cycle without one, all that take part."""
    present = np.diag(alpha) < 1.0
    others = alpha.copy()
    np.fill_diagonal(others, 0.0)
    top = present & ~others.any(axis=1)
    return top if top.any() else present
