"""Changes of a controller's numbers while it runs: checked as a config is, taken as a whole."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any

from pydantic import Field

from hoap3.protocol.config.dotted_keys import join_key, split_key
from hoap3.protocol.config.settings import Settings, parse
from hoap3.protocol.errors import ConfigError, located, nearest
from hoap3.remote_controller.scheduling.numbers import (
    FILE,
    Number,
    Part,
    Path,
    Place,
    Way,
    at,
    numbers_of,
    private,
    way_of,
)

LONGEST_S = 3600.0  # of a transition
LEAST_PACE = 2.0**-20
SLOWER, FASTER = (
    0.5,
    1.25,
)  # of the pace, after a tick that was held back, and after one that was not


class _Over(Settings):
    over_s: Annotated[float, Field(ge=0, le=LONGEST_S)]


def cosine(gone: float) -> float:
    """(15) of Liu, Tan and Padois (2015): the share of a way, of the time that is gone."""
    return 0.5 - 0.5 * math.cos(math.pi * gone)


class Changes:
    """Numbers of settings that move to where they shall be, and all that is asked before they do.

    A transition has a clock of its own, in periods. It goes with the robot's ticks, but for those
    at which it is held back; after such a one it goes on at half the pace, and gathers speed again.

    Args:
        parts: first the controller's own settings, then those of its tasks and constraints.
        check: refuses settings of the controller, as at its start.
        over_s: how long a transition takes where a change says nothing [s].
        period_s: T [s].

    Attributes:
        numbers: what may change.
        moving: whether something is on its way.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        check: Callable[[Any], None],
        over_s: float,
        period_s: float,
    ) -> None:
        self._parts, self._check = tuple(parts), check
        self._over_s, self._period_s = over_s, period_s
        self.numbers = numbers_of(self._parts)
        self._known = {tuple(map(str, number.place)): number for number in self.numbers}
        self._known |= {number.path: number for number in self.numbers}
        self._words = {
            number.place[:end]: number.path[:end]
            for number in self.numbers
            for end in range(1, len(number.place) + 1)
        }
        self._first = [number.read() for number in self.numbers]
        self._file = [private(part.settings) for part in self._parts]
        self._changed = False
        self._forget()

    def _forget(self) -> None:
        self._goals = self._file
        self._ways: list[Way] = []
        self._moved: list[Part] = []
        self._clock = self._before = self._ahead = 0.0
        self._pace, self._tick = 1.0, -1
        self.moving = False

    def reset(self) -> None:
        """Go back to the numbers of the config."""
        if not self._changed:
            return
        self._forget()
        self._changed = False
        for number, value in zip(self.numbers, self._first, strict=True):
            number.write(value)
        for part in self._parts:
            part.take(part.settings)

    def rehearse(self) -> None:
        """Check the present numbers once, as a request is: the first time takes milliseconds."""
        self._validated([(number, number.read()) for number in self.numbers])

    def request(self, content: Mapping[str, Any]) -> None:
        """Let numbers set out for others, from the next tick on.

        Args:
            content: by their keys as in the parameters of a config, nested or with dots, tasks by
                name or number; and `over_s` [s].

        Raises:
            UsageError: something is wrong with it; nothing has changed then.
        """
        wanted = dict(content)
        over_s = self._over_s
        if "over_s" in wanted:
            over_s = parse(_Over, {"over_s": wanted.pop("over_s")}, FILE).over_s
        if not self.numbers:
            raise ConfigError(FILE, "", None, "this controller takes none while it runs", "")
        asked = self._each_once(self._asked(wanted, ()))
        if not asked:
            raise ConfigError(FILE, "", None, "names no number", self._may_change())
        goals = self._validated(asked)
        over = max(over_s / self._period_s, 1.0)
        ways = {
            number.key: way_of(
                number,
                self._parts[number.part],
                at(goals[number.part], number.inner),
                self._clock,
                over,
            )
            for number, _ in asked
        }
        kept = [way for way in self._ways if way.number.key not in ways]
        self._goals, self._ways = goals, [*kept, *ways.values()]
        self._moved = [self._parts[i] for i in sorted({way.number.part for way in self._ways})]
        self.moving = self._changed = True

    def advance(self, tick: int) -> None:
        """Move to a tick; `keep` follows, or `undo` and `hold`."""
        gone = 1 if self._tick < 0 else max(tick - self._tick, 0)
        self._tick, self._before = tick, self._clock
        self._ahead = self._clock + gone * self._pace
        self.redo()

    def undo(self) -> None:
        """Be where we were before `advance`."""
        self._clock = self._before
        self._write()

    def redo(self) -> None:
        """Be where `advance` led, after all."""
        self._clock = self._ahead
        self._write()

    def hold(self) -> None:
        """Stay where `undo` led, and go on from there more slowly."""
        self._pace = max(self._pace * SLOWER, LEAST_PACE)

    def keep(self) -> None:
        """Stay where `advance` led."""
        self._pace = min(self._pace * FASTER, 1.0)
        self._ways = [way for way in self._ways if self._clock < way.begin + way.over]
        if not self._ways:
            self.moving, self._tick, self._pace = False, -1, 1.0

    def shown(self) -> dict[str, Any]:
        """What may change, as it is now, by its keys."""
        found: dict[str, Any] = {}
        for number in self.numbers:
            inner = found
            for part in number.path[:-1]:
                inner = inner.setdefault(part, {})
            inner[number.path[-1]] = number.read()
        return found

    def described(self) -> list[dict[str, Any]]:
        """What may change: meaning and bounds of each."""
        return [number.described() for number in self.numbers]

    def _write(self) -> None:
        for way in self._ways:
            way.number.write(way.at(self._clock, cosine))
        for part in self._moved:
            part.take(part.settings)

    def _each_once(self, asked: Iterable[tuple[Path, Number, Any]]) -> list[tuple[Number, Any]]:
        """Numbers that are named, with what they shall be.

        Raises:
            ConfigError: two keys name the same.
        """
        found: dict[str, tuple[str, Number, Any]] = {}
        for path, number, value in asked:
            key = join_key(path)
            if number.key in found:
                first = found[number.key][0]
                problem = f"is the same number as {first}, which this change has, too"
                raise ConfigError(FILE, key, value, problem, "Give one of them")
            found[number.key] = key, number, value
        return [(number, value) for _, number, value in found.values()]

    def _asked(self, node: Mapping[str, Any], prefix: Path) -> Iterator[tuple[Path, Number, Any]]:
        """Each number that is named, as it is, with what it shall be."""
        for key, value in node.items():
            path = (*prefix, str(key))
            if not self._begins(path):
                path = (*prefix, *split_key(str(key)))
            number = self._known.get(path)
            if number is not None:
                yield path, number, value
            elif isinstance(value, Mapping) and value and self._begins(path):
                yield from self._asked(value, path)
            else:
                raise self._refused(path, value)

    def _begins(self, path: Path) -> bool:
        return any(known[: len(path)] == path for known in self._known)

    def _refused(self, path: Path, value: Any) -> ConfigError:
        key = join_key(path)
        problem = "unknown key"
        if self._begins(path):
            problem = "has numbers below it"
        elif self._exists(path):
            problem = "does not change while it runs"
        return ConfigError(FILE, key, value, problem, self._may_change(key))

    def _exists(self, path: Path) -> bool:
        found: Any = self._parts[0].settings
        for part in path:
            if isinstance(found, Settings):
                found = getattr(found, part, self) if part in type(found).model_fields else self
            elif isinstance(found, tuple):
                labels = [str(getattr(each, "label", i)) for i, each in enumerate(found)]
                found = found[labels.index(part)] if part in labels else self
            else:
                found = found.get(part, self) if isinstance(found, Mapping) else self
        return found is not self

    def _may_change(self, key: str = "") -> str:
        keys = [number.key for number in self.numbers]
        close = nearest(key, keys) if key else None
        guess = f"Did you mean {close!r}? " if close else ""
        return f"{guess}What may: {', '.join(keys)}"

    def _validated(self, asked: Sequence[tuple[Number, Any]]) -> list[Settings]:
        """The settings of all parts with what is asked for, as a config that has it would.

        Raises:
            ConfigError: a config with it would be refused; with keys in people's words.
        """
        try:
            return self._goals_of(asked)
        except ConfigError as error:
            raise self._in_words(error) from error

    def _in_words(self, error: ConfigError) -> ConfigError:
        """The same error, and the others in it, with tasks and constraints by name."""
        keys = error.key.split(".")
        for end in range(len(keys), 0, -1):
            place = tuple(int(key) if key.isdecimal() else key for key in keys[:end])
            if place in self._words:
                keys[:end] = [join_key([word]) for word in self._words[place]]
                break
        others = [self._in_words(each) for each in error.others]
        key, problem, remedy = ".".join(keys), error.problem, error.remedy
        return type(error)(error.file, key, error.value, problem, remedy, others)

    def _goals_of(self, asked: Sequence[tuple[Number, Any]]) -> list[Settings]:
        """The same, with keys as the config has them.

        What is so already stays as it stands there: a default is no more than that, and may be
        fitted to the robot.
        """
        root = self._goals[0]
        content = _thawed(root.model_dump(exclude_unset=True))
        for number, value in asked:
            if not _is(value, at(self._goals[number.part], number.inner)):
                _put(content, number.place, value, root)
        goals: list[Settings] = []
        for part in self._parts:
            below = _content_at(content, part.place)
            key = ".".join(map(str, part.place))
            goals.append(parse(type(part.settings), below, FILE, key))
        self._check(goals[0])
        for part, goal in zip(self._parts, goals, strict=True):
            with located(FILE, ".".join(map(str, part.place))):
                part.fits(goal)
        return goals


def _is(value: Any, goal: Any) -> bool:
    """Whether a value that is asked for is the present one; only numbers are compared."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and isinstance(goal, int | float) and value == goal


def _thawed(value: Any) -> Any:
    """Content of a config as it can be written to."""
    if isinstance(value, dict):
        return {key: _thawed(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_thawed(each) for each in value]
    return value


def _put(content: Any, place: Place, value: Any, root: Settings) -> None:
    """Write a value into the content of a config, with what it leaves to the defaults above it."""
    for i, part in enumerate(place[:-1]):
        if isinstance(content, dict) and part not in content:
            inner = at(root, place[: i + 1])
            content[part] = _thawed(inner.model_dump() if isinstance(inner, Settings) else inner)
        content = content[part]
    content[place[-1]] = value


def _content_at(content: Any, place: Place) -> dict[str, Any]:
    for part in place:
        content = content.get(part, {}) if isinstance(content, dict) else content[part]
    found: dict[str, Any] = content
    return found
