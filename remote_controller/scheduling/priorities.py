"""The priorities of tasks at each time: from a config, its timeline, and live changes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.protocol.messages import FloatArray
from hoap3.remote_controller.scheduling.priority_matrix import start_matrix, without, write
from hoap3.remote_controller.scheduling.schedule import Change, change_of, timeline_of
from hoap3.remote_controller.scheduling.settings import ChangeRequest, PrioritySettings
from hoap3.remote_controller.scheduling.transition import Transition

LIVE = "change of priorities"


class Priorities:
    """A matrix of priorities that moves smoothly.

    alpha_ij is the priority of task j over task i (Liu, Tan and Padois 2015, (4) and (11)): 1 keeps
    i out of j's directions. Cycles are allowed. What is set is remembered for tasks that take no
    part, and holds when they are inserted. A change begins with the values of its moment, so that
    alpha is continuous unless a change is to be made at once.

    Time is that since the controller began, from the robot's ticks, and does not go back. To be
    called from one thread.

    Args:
        names: of the tasks, in the order of rows and columns.
        start: alpha of all of them at the start, (k, k).
        inactive: tasks that take no part at the start.
        timeline: changes by their time.

    Attributes:
        names: of the tasks.
        alpha: (k, k) at the time of the last `update`; the same memory for ever.
        moving: whether a transition is under way.
    """

    def __init__(
        self,
        names: Sequence[str],
        start: FloatArray,
        inactive: Sequence[int] = (),
        timeline: Sequence[Change] = (),
    ) -> None:
        self.names = tuple(names)
        self.moving = False
        self._start, self._inactive = start.copy(), list(inactive)
        self._timeline = (*timeline,)
        self._wanted, self._goal, self._former = start.copy(), start.copy(), start.copy()
        self._out = np.zeros(len(names), bool)
        self._transition = Transition(start)
        self.alpha = self._transition.value
        self.reset()

    @classmethod
    def configured(
        cls, names: Sequence[str], settings: PrioritySettings, file: str, key: str
    ) -> Priorities:
        """Priorities of a config.

        Args:
            names: of the tasks.
            settings: as they stand there.
            file, key: where they stand, for errors.

        Raises:
            ConfigError: tasks of one name, a matrix of another size, an unknown task, one that is
                named twice, or changes of the timeline that contradict each other.
        """
        for i, name in enumerate(names):
            if name in names[:i]:
                raise ConfigError(file, key, name, "two tasks have this name", "Rename one")
        start = start_matrix(names, settings, file, key)
        timeline = timeline_of(settings, names, file, key)
        inactive = [names.index(name) for name in settings.inactive]
        return cls(names, start, inactive, timeline)

    def reset(self) -> None:
        """Go back to the start and its timeline; live changes are forgotten."""
        self._wanted[:] = self._start
        self._out[:] = False
        self._out[self._inactive] = True
        without(self._wanted, self._out, self._goal)
        self._transition.rest(self._goal)
        self._next, self._changed, self.moving = 0, False, False
        self._next_at = self._timeline[0].at_s if self._timeline else math.inf

    def update(self, time_s: float) -> bool:
        """Recompute alpha for a time since the reset [s]; whether it is another than before."""
        if not (self.moving or self._changed) and time_s < self._next_at:
            return False
        self._advance(time_s)
        changed, self._changed = self._changed, False
        return changed

    def change(self, request: Mapping[str, Any], time_s: float) -> None:
        """Begin a change that the timeline does not have; `alpha` is as it begins at once.

        Args:
            request: one of `set`: [[A, B, alpha], ...], `order`, `insert` and `remove`, with
                `over_s` [s], as in a timeline.
            time_s: now, since the reset [s].

        Raises:
            ConfigError: something is wrong with it; nothing has been changed then.
        """
        content = dict(request) if isinstance(request, Mapping) else request
        asked = parse(ChangeRequest, content, LIVE)
        self._advance(time_s)
        out = np.flatnonzero(self._out).tolist()
        self._set_out(change_of(asked, self.names, out, time_s, LIVE, ""))
        self._advance(time_s)

    def shown(self) -> dict[str, Any]:
        """Names, alpha row by row, whether it moves, and tasks that are out, as a JSON object."""
        out = [name for name, left in zip(self.names, self._out, strict=True) if left]
        rows = self.alpha.tolist()
        return {"names": list(self.names), "alpha": rows, "moving": self.moving, "out": out}

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
        self.moving = True
