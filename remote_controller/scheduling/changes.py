"""Live changes of settings: checked as a config is, applied as a whole, moved smoothly.

The numbers that may change are declared in the pydantic models (`protocol.config.changeable`). A
request is merged into the present parameters, the models validate the result, and each object
reads its part with `apply(parameters)`, at the start, for a change, and at every step of the way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from hoap3.protocol.config.changeable import is_changeable, unset_of
from hoap3.protocol.config.dotted_keys import join_key, split_key
from hoap3.protocol.config.settings import Settings, parse
from hoap3.protocol.errors import ConfigError, located, nearest
from hoap3.protocol.robot.description import RobotDescription

Place = tuple[str | int, ...]
Path = tuple[str, ...]
FILE = "change"
"""What errors call a change, in place of a file."""
LONGEST_S = 3600.0  # of a transition
LEAST_PACE = 2.0**-20
SLOWER, FASTER = 0.5, 1.25  # of the pace: after a saturated tick, and after others


class _Over(Settings):
    over_s: Annotated[float, Field(ge=0, le=LONGEST_S)]


@dataclass(frozen=True)
class Part:
    """Settings in force, some numbers of which may change, and the function that applies them.

    Attributes:
        path: of the settings among those of the controller, with tasks and constraints by name.
        place: the same as the config has it, with entries of lists by number.
        settings: a `private` copy, into which changed numbers are written.
        apply: reads the settings into the running object; `ConfigError` with the key inside the
            settings where they do not fit. None where the object reads `settings` itself.
        fixed: dotted keys inside these settings that are declared changeable, but have no effect.
    """

    path: Path
    place: Place
    settings: Settings
    apply: Callable[[Any], None] | None
    fixed: frozenset[str] = frozenset()


def part_of(owner: Any, path: Path, place: Place) -> list[Part]:
    """The parameters of a task or constraint at an entry of a config.

    Empty where only the base class of `owner` has an `apply`: it cannot take changes.
    """
    if sum("apply" in vars(kind) for kind in type(owner).__mro__) < 2:
        return []
    path, place = (*path, "parameters"), (*place, "parameters")
    return [Part(path, place, private(owner.parameters), owner.apply)]


def private(settings: Settings) -> Settings:
    """A copy whose numbers can be written; all else is shared."""
    copied = settings.model_copy()
    for name, value in list(copied.__dict__.items()):
        if isinstance(value, Settings):
            copied.__dict__[name] = private(value)
        elif isinstance(value, tuple) and any(isinstance(each, Settings) for each in value):
            copied.__dict__[name] = tuple(
                private(each) if isinstance(each, Settings) else each for each in value
            )
    return copied


@dataclass(frozen=True)
class Number:
    """One setting that may change: a number, or a tuple of some.

    Attributes:
        part: index of the part that it belongs to.
        path, place: among the settings of the controller, as of `Part`.
        inner: place among the settings of its part.
        owner, name: the settings that have it, and the attribute.
    """

    part: int
    path: Path
    place: Place
    inner: Place
    owner: Settings
    name: str

    @property
    def key(self) -> str:
        """Dotted key by which requests name it."""
        return join_key(self.path)

    def read(self) -> Any:
        """Return the present value."""
        return getattr(self.owner, self.name)

    def write(self, value: Any) -> None:
        """Set the present value, although settings are frozen elsewhere."""
        self.owner.__dict__[self.name] = value

    def numbers(self, value: Any, robot: RobotDescription) -> tuple[float, ...] | None:
        """A value as numbers; what it stands for where it is unset, None where nothing does."""
        if value is None or value == ():
            unset = unset_of(type(self.owner).model_fields[self.name])
            if unset is None:
                return None
            value = unset.value(self.owner, robot)
        return (float(value),) if isinstance(value, int | float) else tuple(map(float, value))

    def described(self) -> dict[str, Any]:
        """Key, meaning, and the bounds that its field declares, null where there is none."""
        field = type(self.owner).model_fields[self.name]
        bounds: dict[str, float | None] = {"lower": None, "upper": None}
        for fact in field.metadata:
            for end, names in (("lower", ("ge", "gt")), ("upper", ("le", "lt"))):
                for name in names:
                    bounds[end] = getattr(fact, name, bounds[end])
        return {"key": self.key, "meaning": field.description or "", **bounds}


@dataclass(frozen=True)
class Way:
    """The way of a number from one value to another.

    Attributes:
        number: which.
        before, after: its settings at both ends.
        start, goal: the same as numbers of one length.
        begin, over: of the transition, in periods.
    """

    number: Number
    before: Any
    after: Any
    start: tuple[float, ...]
    goal: tuple[float, ...]
    begin: float
    over: float

    def at(self, clock: float) -> Any:
        """The setting at a time, in periods: by (15) of Liu, Tan and Padois (2015)."""
        gone = (clock - self.begin) / self.over
        if gone >= 1.0:
            return self.after
        if gone <= 0.0:
            return self.before
        if self.before is None and self.after is None:
            return None  # it follows another number, which may be moving
        done = 0.5 - 0.5 * math.cos(math.pi * gone)
        found = tuple(a + (b - a) * done for a, b in zip(self.start, self.goal, strict=True))
        many = isinstance(self.after, tuple) or isinstance(self.before, tuple)
        return found if many else found[0]


class Changes:
    """The changeable numbers of a controller, and the transitions that are under way.

    A transition has a clock of its own, in periods. It goes with the robot's ticks, but for those
    at which it is saturated; after such a one it goes on at half the pace, and gathers speed again.

    Args:
        parts: first the controller's own settings, then those of its tasks and constraints.
        validate: refuses settings of the controller that its `apply` lets pass.
        over_s: duration of a transition where a request gives none [s].
        robot: its description.

    Attributes:
        numbers: what may change.
        moving: whether a transition is under way.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        validate: Callable[[Any], None],
        over_s: float,
        robot: RobotDescription,
    ) -> None:
        self._parts, self._validate = tuple(parts), validate
        self._over_s, self._robot = over_s, robot
        self.numbers = [
            Number(i, (*part.path, *path), (*part.place, *inner), inner, owner, name)
            for i, part in enumerate(self._parts)
            for path, inner, owner, name in _changeable_below(part.settings, (), ())
            if ".".join(map(str, inner)) not in part.fixed
        ]
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
        self._apply_present(self._parts)

    def rehearse(self) -> None:
        """Check the present numbers once, as a request is: the first time takes milliseconds."""
        self._validated([(number, number.read()) for number in self.numbers])

    def request(self, content: Mapping[str, Any]) -> None:
        """Start transitions to other numbers, from the next tick on.

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
        over = max(over_s / self._robot.period_s, 1.0)
        ways = {
            number.key: self._way_to(number, _at(goals[number.part], number.inner), over)
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
        """The present values of all numbers, nested by their keys."""
        found: dict[str, Any] = {}
        for number in self.numbers:
            inner = found
            for part in number.path[:-1]:
                inner = inner.setdefault(part, {})
            inner[number.path[-1]] = number.read()
        return found

    def described(self) -> list[dict[str, Any]]:
        """Key, meaning and bounds of all numbers."""
        return [number.described() for number in self.numbers]

    def _write(self) -> None:
        for way in self._ways:
            way.number.write(way.at(self._clock))
        self._apply_present(self._moved)

    def _apply_present(self, parts: Sequence[Part]) -> None:
        for part in parts:
            if part.apply is not None:
                part.apply(part.settings)

    def _way_to(self, number: Number, after: Any, over: float) -> Way:
        """The way of a number from its present value to another.

        Raises:
            ConfigError: one of both is null and stands for no number, the goal would follow
                another number, or they are of different lengths.
        """
        before = number.read()
        unset = unset_of(type(number.owner).model_fields[number.name])
        if after is None and before is not None and unset is not None and unset.follows:
            problem = f"is null, and would follow {unset.follows} at once"
            raise ConfigError(FILE, number.key, after, problem, "Give it as a number")
        start, goal = (number.numbers(value, self._robot) for value in (before, after))
        if start is None or goal is None:
            problem = "is null now" if start is None else "is null"
            remedy = "No number stands for it while it runs: set it in the config, and restart"
            raise ConfigError(FILE, number.key, after, problem, remedy)
        longest = max(len(start), len(goal))
        start, goal = (each * longest if len(each) == 1 else each for each in (start, goal))
        if len(start) != len(goal):
            problem, remedy = f"has {len(goal)} numbers", f"Give one, or {len(start)}"
            raise ConfigError(FILE, number.key, after, problem, remedy)
        return Way(number, before, after, start, goal, self._clock, over)

    def _each_once(self, asked: Iterable[tuple[Path, Number, Any]]) -> list[tuple[Number, Any]]:
        """Numbers that are named, with their requested values.

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
        """Each number that is named, by the path in the request, with its requested value."""
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
        """The settings of all parts with the requested values, checked as those of a config.

        Each object applies its settings to see whether they fit, and then the present ones again.

        Raises:
            ConfigError: a config with them would be refused; keys have tasks by name.
        """
        try:
            goals = self._merged(asked)
            with located(FILE):
                self._validate(goals[0])
            try:
                for part, goal in zip(self._parts, goals, strict=True):
                    if part.apply is not None:
                        with located(FILE, ".".join(map(str, part.place))):
                            part.apply(goal)
            finally:
                self._apply_present(self._parts)
        except ConfigError as error:
            raise self._in_words(error) from error
        return goals

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

    def _merged(self, asked: Sequence[tuple[Number, Any]]) -> list[Settings]:
        """The settings of all parts with the requested values, validated by their models.

        A value that is the present one stays as the config has it: a default remains unset, which
        may be fitted to the robot.
        """
        root = self._goals[0]
        content = _thawed(root.model_dump(exclude_unset=True))
        for number, value in asked:
            if not _is(value, _at(self._goals[number.part], number.inner)):
                _put(content, number.place, value, root)
        return [
            parse(
                type(part.settings),
                _content_at(content, part.place),
                FILE,
                ".".join(map(str, part.place)),
            )
            for part in self._parts
        ]


def _changeable_below(
    settings: Settings, path: Path, inner: Place
) -> Iterator[tuple[Path, Place, Settings, str]]:
    """Path, place, settings and name of each changeable field of settings, and below them."""
    for name, field in type(settings).model_fields.items():
        value = getattr(settings, name)
        if is_changeable(field):
            yield (*path, name), (*inner, name), settings, name
        elif isinstance(value, Settings):
            yield from _changeable_below(value, (*path, name), (*inner, name))
        elif isinstance(value, tuple):
            for i, each in enumerate(value):
                if isinstance(each, Settings):
                    label = str(getattr(each, "label", i))
                    yield from _changeable_below(each, (*path, name, label), (*inner, name, i))


def _at(settings: Any, place: Place) -> Any:
    """The value at a place of settings."""
    for part in place:
        settings = settings[part] if isinstance(part, int) else getattr(settings, part)
    return settings


def _is(value: Any, goal: Any) -> bool:
    """Whether a requested value is the present one; only numbers are compared."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and isinstance(goal, int | float) and value == goal


def _thawed(value: Any) -> Any:
    """Content of a config that can be written to."""
    if isinstance(value, dict):
        return {key: _thawed(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_thawed(each) for each in value]
    return value


def _put(content: Any, place: Place, value: Any, root: Settings) -> None:
    """Write a value into the content of a config, with the defaults of levels that it omits."""
    for i, part in enumerate(place[:-1]):
        if isinstance(content, dict) and part not in content:
            inner = _at(root, place[: i + 1])
            content[part] = _thawed(inner.model_dump() if isinstance(inner, Settings) else inner)
        content = content[part]
    content[place[-1]] = value


def _content_at(content: Any, place: Place) -> dict[str, Any]:
    for part in place:
        content = content.get(part, {}) if isinstance(content, dict) else content[part]
    found: dict[str, Any] = content
    return found
