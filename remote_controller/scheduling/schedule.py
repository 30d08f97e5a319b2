"""Changes of priorities, checked against the tasks, and in the order of their time."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from hoap3.protocol.errors import ConfigError
from hoap3.remote_controller.scheduling.priority_matrix import (
    Entries,
    order_entries,
    places,
    set_entries,
)
from hoap3.remote_controller.scheduling.settings import ChangeRequest, PrioritySettings


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

    @property
    def end_s(self) -> float:
        """When it is over [s]."""
        return self.at_s + self.over_s

    def pairs(self, k: int) -> frozenset[tuple[int, int]]:
        """Pairs of the k tasks that it concerns, the lower number first."""
        whole = {(i, j) for i in (*self.inserted, *self.removed) for j in range(k)}
        return frozenset((min(i, j), max(i, j)) for i, j in {e[:2] for e in self.entries} | whole)


def change_of(
    request: ChangeRequest,
    names: Sequence[str],
    out: Collection[int],
    at_s: float,
    file: str,
    key: str,
) -> Change:
    """A request, with numbers for the names.

    Args:
        request: what is asked for.
        names: of the tasks.
        out: tasks that take no part before it.
        at_s: its begin [s].
        file, key: where it stands, for errors.

    Raises:
        ConfigError: an unknown task, one that is named twice, a pair that is set twice, or a task
            that is to be inserted and takes part already, or removed and does not.
    """
    at = f"{key}." if key else ""
    entries = (
        *set_entries(request.set, names, file, f"{at}set"),
        *order_entries(request.order, names, file, f"{at}order"),
    )
    inserted = places(request.insert, names, file, f"{at}insert")
    removed = places(request.remove, names, file, f"{at}remove")
    for i in inserted:
        if i not in out:
            problem, remedy = "takes part already", "Insert what was removed, or is `inactive`"
            raise ConfigError(file, f"{at}insert", names[i], problem, remedy)
    for i in removed:
        if i in out:
            problem, remedy = "takes no part", "Remove what takes part"
            raise ConfigError(file, f"{at}remove", names[i], problem, remedy)
    return Change(at_s, request.over_s, entries, inserted, removed)


def timeline_of(
    settings: PrioritySettings, names: Sequence[str], file: str, key: str
) -> tuple[Change, ...]:
    """The changes of a config by their time.

    Raises:
        ConfigError: see `change_of`; or two changes of one pair that overlap in time.
    """
    given = sorted(enumerate(settings.timeline), key=lambda item: item[1].at_s)
    out = set(places(settings.inactive, names, file, f"{key}.inactive"))
    changes: list[Change] = []
    for number, request in given:
        where = f"{key}.timeline.{number}"
        change = change_of(request, names, out, request.at_s, file, where)
        for (other, _), earlier in zip(given, changes, strict=False):
            _apart(earlier, change, names, file, where, other)
        out = (out | {*change.removed}) - {*change.inserted}
        changes.append(change)
    return tuple(changes)


def _apart(
    earlier: Change, later: Change, names: Sequence[str], file: str, key: str, other: int
) -> None:
    """Refuse two changes of one pair, unless one is over when the other begins."""
    if later.at_s > earlier.at_s and later.at_s >= earlier.end_s:
        return
    shared = earlier.pairs(len(names)) & later.pairs(len(names))
    if shared:
        i, j = min(shared)
        problem = (
            f"overlaps timeline.{other}, {earlier.at_s:g} s to {earlier.end_s:g} s, in the "
            f"priorities of {names[i]} and {names[j]}"
        )
        remedy = f"Let one end before the other begins: at_s {max(earlier.end_s, later.at_s):g}"
        if earlier.end_s == later.at_s:
            remedy = "Make one change of both, or give them different times"
        raise ConfigError(file, f"{key}.at_s", later.at_s, problem, remedy)
