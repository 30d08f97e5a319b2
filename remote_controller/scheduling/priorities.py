"""The priorities of tasks at each time: from a config, its timeline, and live changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.scheduling.priority_matrix import start_matrix, without, write
from hoap3.remote_controller.scheduling.schedule import Change, Schedule, change_of, timeline_of
from hoap3.remote_controller.scheduling.settings import ChangeRequest, PrioritySettings


class Priorities(Schedule):
    """A matrix of priorities that moves smoothly.

    alpha_ij is the priority of task j over task i (Liu, Tan and Padois 2015, (4) and (11)): 1 keeps
    i out of j's directions. Cycles are allowed. What is set is remembered for tasks that take no
    part, and holds when they are inserted.

    Args:
        names: of the tasks, in the order of rows and columns.
        start: alpha of all of them at the start, (k, k).
        inactive: tasks that take no part at the start.
        timeline: changes by their time.

    Attributes:
        alpha: (k, k) at the time of the last `update`; the same memory for ever.
    """

    live, request = "change of priorities", ChangeRequest

    def __init__(
        self,
        names: Sequence[str],
        start: FloatArray,
        inactive: Sequence[int] = (),
        timeline: Sequence[Change] = (),
    ) -> None:
        self._inactive = list(inactive)
        self._wanted, self._former = start.copy(), start.copy()
        self._out = np.zeros(len(names), bool)
        super().__init__(names, start, timeline)
        self.alpha = self._transition.value

    @classmethod
    def configured(cls, names: Sequence[str], settings: PrioritySettings) -> Priorities:
        """Priorities of a config.

        Args:
            names: of the tasks.
            settings: as they stand there.

        Raises:
            ConfigError: tasks of one name, a matrix of another size, an unknown task, one that is
                named twice, or changes of the timeline that contradict each other.
        """
        for i, name in enumerate(names):
            if name in names[:i]:
                raise ConfigError("", "", name, "two tasks have this name", "Rename one")
        start = start_matrix(names, settings)
        timeline = timeline_of(settings, names)
        inactive = [names.index(name) for name in settings.inactive]
        return cls(names, start, inactive, timeline)

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
        return change_of(request, self.names, np.flatnonzero(self._out).tolist(), time_s)

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
