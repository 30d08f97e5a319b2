"""Parameters that were changed while a controller ran: what each was at every State of a log.

The config of the log has those of the start; each logged request names others, and how long they
take. What a config leaves out is what the settings' models have by default. From there on all is
computed here: the clock of the transitions, with the ticks at which they were held back, as the
log says, and (15) of Liu, Tan and Padois (2015) between both ends.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hoap3.protocol.config.dotted_keys import join_key, split_key
from hoap3.protocol.config.settings import Settings, parse
from hoap3.protocol.robot.description import RobotDescription
from hoap3.remote_controller.constraints import registry as constraints
from hoap3.remote_controller.problems.oracles.tasks.config_oracle import default_entry
from hoap3.remote_controller.registry import find
from hoap3.remote_controller.tasks import registry as tasks

Place = tuple[str | int, ...]
Parameters = dict[str, Any]

OF_CHANGES = frozenset({"change_over_s", "change_jump_rad_s"})
"""Parameters that say how numbers change, and nothing of a cycle."""
OVER_S = 0.5  # where neither request nor config says
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


class ParametersInForce:
    """The parameters of a controller, State by State.

    Args:
        controller: its registered name.
        description: of the robot.
        parameters: of the log's config.
        over_s: how long a change takes that does not say [s].

    Attributes:
        values: what is no longer that of the config, by its place in it.

    Raises:
        LookupError, ValueError, UsageError: a change that no controller has taken.
    """

    def __init__(
        self, controller: str, description: RobotDescription, parameters: Mapping[str, Any]
    ) -> None:
        self._description = description
        self._over_s = float(parameters.get("change_over_s", OVER_S))
        self._given = {key: value for key, value in parameters.items() if key not in OF_CHANGES}
        model: type[Settings] = find(controller).Parameters
        if self._given.get("tasks", 0) is None or (
            "tasks" not in self._given and model.model_fields.keys() >= {"tasks", "damping"}
        ):
            self._given["tasks"] = [dict(default_entry(description))]
        self._settings = parse(model, self._given, "config")
        self.values: dict[Place, Any] = {}
        self._ways: dict[Place, Way] = {}
        self._clock, self._pace, self._last = 0.0, 1.0, -1

    def ask(self, request: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
        """Take a request, which counts from the next State on.

        Returns:
            dotted key, value before and value after of each parameter.
        """
        ways = self._ways_of(request)
        self._ways |= {place: way for _, place, way in ways}
        return [(key, *way.ends) for key, _, way in ways]

    def reset(self) -> None:
        """Return to the parameters of the config, with the State that follows."""
        self.values, self._ways = {}, {}
        self._clock, self._pace, self._last = 0.0, 1.0, -1

    def advance(self, tick: int, *, held: bool) -> None:
        """Go on to the next State.

        Args:
            tick: of the State.
            held: whether changes are held back there.
        """
        if not self._ways:
            return
        gone = 1 if self._last < 0 else max(tick - self._last, 0)
        self._last, ahead = tick, self._clock + gone * self._pace
        self._clock = self._clock if held else ahead
        present = {key: way.at(self._clock) for key, way in self._ways.items()}
        self.values = {**self.values, **present}
        if held:
            self._pace = max(self._pace * SLOWER, LEAST_PACE)
            return
        self._pace = min(self._pace * FASTER, 1.0)
        self._ways = {
            key: way for key, way in self._ways.items() if self._clock < way.since + way.periods
        }
        if not self._ways:
            self._last, self._pace = -1, 1.0

    def parameters(self, values: Mapping[Place, Any] | None = None) -> Parameters:
        """The parameters of the config with `values`, by default those of now."""
        content = self._given
        for place, value in (self.values if values is None else values).items():
            content = self._with(content, place, value)
        return content

    def _ways_of(self, request: Mapping[str, Any]) -> list[tuple[str, Place, Way]]:
        """Key, place and way of each parameter that a request names."""
        content = dict(request)
        over_s = float(content.pop("over_s", self._over_s))
        over = max(over_s / self._description.period_s, 1.0)
        ways = []
        lists = (self._given.get(key) or () for key in ("tasks", "constraints"))
        labels = [label for entries in lists for label in _labels(entries)]
        for path, after in _leaves(content, (), labels):
            place = self._place_of(path)
            before = self.values[place] if place in self.values else self._read(place)
            ends = [self._spread(place, value) for value in (before, after)]
            longest = max(map(len, ends))
            start, goal = (each * longest if len(each) == 1 else each for each in ends)
            way = Way((before, after), (start, goal), self._clock, over)
            ways.append((join_key(path), place, way))
        return ways

    def _spread(self, place: Place, value: Any) -> tuple[float, ...]:
        """A value as numbers; what stands for one that is null."""
        if value is None or value in ((), []):
            value = self._stands_for(place)
        return (float(value),) if isinstance(value, int | float) else tuple(map(float, value))

    def _stands_for(self, place: Place) -> float:
        name, description = place[-1], self._description
        if name in {"speed_rad_s", "limit_rad_s"}:
            return float(description.velocity.max())
        if name == "kd":
            beside = (*place[:-1], "kp")
            kp = self.values[beside] if beside in self.values else self._read(beside)
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
