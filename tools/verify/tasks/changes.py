"""Numbers that were changed while a controller ran: what each was at every State of a log.

The config of the log has those of the start; each logged request names others, and how long they
take. What a config leaves out is what the settings' models have by default. From there on all is
computed here: the clock of the transitions, with the ticks at which they were held back, as the
log tells, and (15) of Liu, Tan and Padois (2015) between both ends.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hoap3.protocol.config.dotted_keys import split_key
from hoap3.protocol.config.settings import Settings, parse
from hoap3.remote_controller.constraints import registry as constraints
from hoap3.remote_controller.registry import find
from hoap3.remote_controller.tasks import registry as tasks
from hoap3.tools.verify.controller_log import ControllerRun
from hoap3.tools.verify.tasks.config import default_entry

Place = tuple[str | int, ...]
Parameters = dict[str, Any]

OF_PRIORITIES = frozenset({"set", "order", "insert", "remove", "weights"})
"""Keys of requests for other priorities, which the checkers follow themselves."""
OF_CHANGES = frozenset({"change_over_s", "change_jump_rad_s"})
"""Parameters that say how numbers change, and nothing of a cycle."""
WHOLE = frozenset({"joint_acceleration", "stable_qp"})
"""Controllers whose answers follow from those before: a part of a run cannot be judged alone."""
OVER_S = 0.5  # where neither request nor config says
HELD_BACK = "a change is held back"
SLOWER, FASTER, LEAST_PACE = 0.5, 1.25, 2.0**-20


@dataclass(frozen=True)
class Way:
    """From a value to another, both numbers of one length, in periods of the transitions' clock."""

    ends: tuple[Any, Any]
    numbers: tuple[tuple[float, ...], tuple[float, ...]]
    since: float
    periods: float

    def at(self, clock: float) -> Any:
        """The value."""
        gone = (clock - self.since) / self.periods
        if gone >= 1.0 or gone <= 0.0:
            return self.ends[int(gone >= 1.0)]
        if self.ends == (None, None):
            return None
        share = 0.5 - 0.5 * math.cos(math.pi * gone)
        found = [a + (b - a) * share for a, b in zip(*self.numbers, strict=True)]
        many = any(isinstance(end, list | tuple) for end in self.ends)
        return found if many else found[0]


def with_numbers(
    run: ControllerRun, controller: str, parameters: Mapping[str, Any]
) -> Iterator[tuple[ControllerRun, Parameters]]:
    """The parts of a run with the parameters that each was answered with.

    Args:
        run: whose changes of priorities stay in its parts.
        controller: its registered name.
        parameters: of the log's config.

    Raises:
        LookupError, ValueError, UsageError: a change that no controller has taken.
    """
    given = {key: value for key, value in parameters.items() if key not in OF_CHANGES}
    asked = [each for each in run.changes if OF_PRIORITIES.isdisjoint(each[1])]
    if not asked:
        yield run, given
        return
    others = [each for each in run.changes if not OF_PRIORITIES.isdisjoint(each[1])]
    run = replace(run, changes=others)
    over_s = parameters.get("change_over_s", OVER_S)
    followed = _Followed(run, controller, given, float(over_s))
    found = followed.at_each_state(asked)
    if controller in WHOLE:
        yield replace(run, in_force=followed.with_each(found)), given
        return
    at_answers = [found[place] for place in run.answered.tolist()]
    first = 0
    while first < len(at_answers):
        end = first + 1
        while end < len(at_answers) and at_answers[end] == at_answers[first]:
            end += 1
        which = np.zeros(len(at_answers), bool)
        which[first:end] = True
        yield run.only(which), followed.with_values(at_answers[first])
        first = end


class _Followed:
    """The numbers of one run over its States."""

    def __init__(
        self, run: ControllerRun, controller: str, given: Parameters, over_s: float
    ) -> None:
        self._run, self._given, self._over_s = run, dict(given), over_s
        model: type[Settings] = find(controller).Parameters
        if self._given.get("tasks", 0) is None or (
            "tasks" not in self._given and model.model_fields.keys() >= {"tasks", "damping"}
        ):
            self._given["tasks"] = [dict(default_entry(run.description))]
        self._settings = parse(model, self._given, "config")
        self._values: dict[Place, Any] = {}  # what is no longer that of the config

    def at_each_state(
        self, asked: Sequence[tuple[int, Mapping[str, Any]]]
    ) -> list[dict[Place, Any]]:
        """What is no longer that of the config, at each State."""
        run, held = self._run, self._held()
        ticks, resets, waiting = run.states["tick"].tolist(), {*run.resets}, [*asked]
        ways: dict[Place, Way] = {}
        clock, pace, last, found = 0.0, 1.0, -1, []
        for place, tick in enumerate(ticks):
            while waiting and waiting[0][0] <= place:
                ways |= self._ways(waiting.pop(0)[1], clock)
            if place in resets:
                self._values, ways, clock, pace, last = {}, {}, 0.0, 1.0, -1
            if ways:
                gone = 1 if last < 0 else max(tick - last, 0)
                last, ahead = tick, clock + gone * pace
                clock = clock if held[place] else ahead
                self._values = {**self._values, **{key: way.at(clock) for key, way in ways.items()}}
                pace = max(pace * SLOWER, LEAST_PACE) if held[place] else min(pace * FASTER, 1.0)
                if not held[place]:
                    ways = {k: way for k, way in ways.items() if clock < way.since + way.periods}
                if not ways:
                    last, pace = -1, 1.0
            found.append(self._values)
        return found

    def with_values(self, values: Mapping[Place, Any]) -> Parameters:
        """The parameters of the config with other values."""
        content = self._given
        for place, value in values.items():
            content = self._with(content, place, value)
        return content

    def with_each(self, found: Sequence[Mapping[Place, Any]]) -> list[Mapping[str, Any]]:
        """The same for each State; one object as long as nothing changes."""
        contents: list[Mapping[str, Any]] = []
        for i, values in enumerate(found):
            same = i > 0 and values == found[i - 1]
            contents.append(contents[-1] if same else self.with_values(values))
        return contents

    def _held(self) -> list[bool]:
        """At which States numbers were held back."""
        names = list(self._run.session.get("conditions") or ())
        count = len(self._run.states)
        held = [False] * count
        if HELD_BACK not in names:
            return held
        mine = [each for each in self._run.conditions if each[1] == names.index(HELD_BACK)]
        ends = [*(each[0] for each in mine[1:]), count][: len(mine)]
        for (place, _, began), end in zip(mine, ends, strict=True):
            held[place:end] = [began] * (end - place)
        return held

    def _ways(self, request: Mapping[str, Any], clock: float) -> dict[Place, Way]:
        content = dict(request)
        over_s = float(content.pop("over_s", self._over_s))
        over = max(over_s / self._run.description.period_s, 1.0)
        ways = {}
        lists = (self._given.get(key) or () for key in ("tasks", "constraints"))
        labels = [label for entries in lists for label in _labels(entries)]
        for path, after in _leaves(content, (), labels):
            place = self._place_of(path)
            before = self._values[place] if place in self._values else self._read(place)
            ends = [self._spread(place, value) for value in (before, after)]
            longest = max(map(len, ends))
            start, goal = (each * longest if len(each) == 1 else each for each in ends)
            ways[place] = Way((before, after), (start, goal), clock, over)
        return ways

    def _spread(self, place: Place, value: Any) -> tuple[float, ...]:
        """A value as numbers; what stands for one that is null."""
        if value is None or value in ((), []):
            value = self._stands_for(place)
        return (float(value),) if isinstance(value, int | float) else tuple(map(float, value))

    def _stands_for(self, place: Place) -> float:
        name, description = place[-1], self._run.description
        if name in {"speed_rad_s", "limit_rad_s"}:
            return float(description.velocity.max())
        if name == "kd":
            beside = (*place[:-1], "kp")
            kp = self._values[beside] if beside in self._values else self._read(beside)
            return 2.0 * math.sqrt(kp)
        if name == "weights":
            return 1.0
        raise ValueError(f"nothing stands for {place}")

    def _place_of(self, path: tuple[str, ...]) -> Place:
        """Where a key stands in the config: entries of lists by their numbers."""
        place: list[str | int] = []
        content: Any = self._given
        for part in path:
            here: str | int = part
            if isinstance(content, list | tuple):
                labels = _labels(content)
                here = labels.index(part) if part in labels else int(part)
                content = content[here]
            else:
                content = content.get(part) if isinstance(content, Mapping) else None
            place.append(here)
        return tuple(place)

    def _read(self, place: Place) -> Any:
        """What the config has there, or the models by default."""
        found: Any = self._settings
        for i, part in enumerate(place):
            if isinstance(found, Mapping):
                found = self._own(place[:i], found)
            found = found[part] if isinstance(part, int) else getattr(found, str(part))
        return found

    def _own(self, place: Place, content: Mapping[str, Any]) -> Settings:
        """The parameters of a task or a constraint, by their own model."""
        entry: Any = self._settings
        for part in place[:-1]:
            entry = entry[part] if isinstance(part, int) else getattr(entry, part)
        kind = constraints.find if hasattr(entry, "constraint") else tasks.find
        named = entry.constraint if hasattr(entry, "constraint") else entry.task
        own: Settings = parse(kind(named).Parameters, dict(content), "config")
        return own

    def _with(self, content: Any, place: Place, value: Any, depth: int = 0) -> Any:
        """Content of the config with another value at a place; all else is shared."""
        part, last = place[depth], depth == len(place) - 1
        copied: Any = list(content) if isinstance(part, int) else dict(content)
        inner = None if last else copied[part] if isinstance(part, int) else copied.get(part)
        if inner is None and not last:
            usual = self._read(place[: depth + 1])
            inner = usual.model_dump() if isinstance(usual, Settings) else {}
        copied[part] = value if last else self._with(inner, place, value, depth + 1)
        return copied


def _leaves(
    node: Mapping[str, Any], prefix: tuple[str, ...], labels: Sequence[str]
) -> Iterator[tuple[tuple[str, ...], Any]]:
    for key, value in node.items():
        path = (*prefix, *([key] if key in labels else split_key(key)))
        if isinstance(value, Mapping):
            yield from _leaves(value, path, labels)
        else:
            yield path, value


def _labels(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of tasks or constraints; equal ones have a number from the second one on."""
    found: list[str] = []
    for each in entries:
        name = str(each.get("name") or each.get("task") or each.get("constraint"))
        label, number = name, 1
        while label in found:
            number += 1
            label = f"{name} {number}"
        found.append(label)
    return found
