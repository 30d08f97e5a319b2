"""Numbers of settings that may change while a controller runs, and the way of each to another."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from hoap3.protocol.config.changeable import is_changeable
from hoap3.protocol.config.dotted_keys import join_key
from hoap3.protocol.config.settings import Settings
from hoap3.protocol.errors import ConfigError

Place = tuple[str | int, ...]
Path = tuple[str, ...]
FILE = "change"
"""What errors call a change, in place of a file."""


FOLLOWS = {"kd": "2√kp"}
"""Numbers that follow another one where they are null, which may be on its own way: no goals."""


def nothing(_: Any) -> None:
    """Refuse nothing."""


@dataclass(frozen=True)
class Part:
    """Settings in force, some numbers of which may change, and who takes these.

    Attributes:
        path: of the settings among those of the controller, in people's words: tasks by name.
        place: the same as the config has it.
        settings: of nobody else; what changes is written into it.
        take: takes them when a number has changed; it may not fail.
        fits: refuses settings that the models let pass, with `ConfigError`.
        unset: what a number stands for that is null, by its dotted key inside these settings.
        fixed: dotted keys inside these settings that are declared changeable, and may not change.
    """

    path: Path
    place: Place
    settings: Settings
    take: Callable[[Any], None]
    fits: Callable[[Any], None] = nothing
    unset: Callable[[str], float | Sequence[float] | None] = nothing
    fixed: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Number:
    """One setting that may change: a number, or some.

    Attributes:
        part: place of the part that it belongs to.
        path, place: among the settings of the controller, in people's words and as a config has it.
        inner: place among the settings of its part.
        owner, name: whose attribute it is.
    """

    part: int
    path: Path
    place: Place
    inner: Place
    owner: Settings
    name: str

    @property
    def key(self) -> str:
        """What people call it."""
        return join_key(self.path)

    def read(self) -> Any:
        """What it is now."""
        return getattr(self.owner, self.name)

    def write(self, value: Any) -> None:
        """Let it be something else; settings are frozen for all others."""
        self.owner.__dict__[self.name] = value

    def described(self) -> dict[str, Any]:
        """Its key, what it means, and within which bounds it is taken, null where there is none."""
        field = type(self.owner).model_fields[self.name]
        bounds: dict[str, float | None] = {"lower": None, "upper": None}
        for fact in field.metadata:
            for end, names in (("lower", ("ge", "gt")), ("upper", ("le", "lt"))):
                for name in names:
                    bounds[end] = getattr(fact, name, bounds[end])
        return {"key": self.key, "meaning": field.description or "", **bounds}


def private(settings: Settings) -> Settings:
    """A copy whose numbers may be written; all else is shared."""
    copied = settings.model_copy()
    for name, value in list(copied.__dict__.items()):
        if isinstance(value, Settings):
            copied.__dict__[name] = private(value)
        elif isinstance(value, tuple) and any(isinstance(each, Settings) for each in value):
            copied.__dict__[name] = tuple(
                private(each) if isinstance(each, Settings) else each for each in value
            )
    return copied


def numbers_of(parts: Sequence[Part]) -> list[Number]:
    """All that may change."""
    return [
        Number(i, (*part.path, *path), (*part.place, *inner), inner, owner, name)
        for i, part in enumerate(parts)
        for path, inner, owner, name in _below(part.settings, (), ())
        if ".".join(map(str, inner)) not in part.fixed
    ]


def _below(
    settings: Settings, path: Path, inner: Place
) -> Iterator[tuple[Path, Place, Settings, str]]:
    for name, field in type(settings).model_fields.items():
        value = getattr(settings, name)
        if is_changeable(field):
            yield (*path, name), (*inner, name), settings, name
        elif isinstance(value, Settings):
            yield from _below(value, (*path, name), (*inner, name))
        elif isinstance(value, tuple):
            for i, each in enumerate(value):
                if isinstance(each, Settings):
                    label = str(getattr(each, "label", i))
                    yield from _below(each, (*path, name, label), (*inner, name, i))


def at(settings: Any, place: Place) -> Any:
    """What stands at a place of settings."""
    for part in place:
        settings = settings[part] if isinstance(part, int) else getattr(settings, part)
    return settings


@dataclass(frozen=True)
class Way:
    """Where a number comes from and goes to.

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

    def at(self, clock: float, share: Callable[[float], float]) -> Any:
        """The setting at a time, in periods.

        Args:
            clock: the time.
            share: of the whole way, of the time that is gone, both from 0 to 1.
        """
        gone = (clock - self.begin) / self.over
        if gone >= 1.0:
            return self.after
        if gone <= 0.0:
            return self.before
        if self.before is None and self.after is None:
            return None  # whatever it stands for now
        done = share(gone)
        found = tuple(a + (b - a) * done for a, b in zip(self.start, self.goal, strict=True))
        many = isinstance(self.after, tuple) or isinstance(self.before, tuple)
        return found if many else found[0]


def way_of(number: Number, part: Part, after: Any, begin: float, over: float) -> Way:
    """The way of a number from what it is now to another value.

    Raises:
        ConfigError: nothing leads there: one of both is null and says nothing of itself, the goal
            would follow another number, or they are of different lengths.
    """
    before = number.read()
    if after is None and before is not None and number.name in FOLLOWS:
        problem = f"is null, and would follow {FOLLOWS[number.name]} at once"
        raise ConfigError(FILE, number.key, after, problem, "Give it as a number")
    key = ".".join(str(each) for each in number.inner)
    start, goal = (_spread(value, part.unset(key)) for value in (before, after))
    if start is None or goal is None:
        problem = "is null now" if start is None else "is null"
        remedy = "No number stands for it while it runs: set it in the config, and begin anew"
        raise ConfigError(FILE, number.key, after, problem, remedy)
    longest = max(len(start), len(goal))
    start, goal = (each * longest if len(each) == 1 else each for each in (start, goal))
    if len(start) != len(goal):
        problem, remedy = f"has {len(goal)} numbers", f"Give one, or {len(start)}"
        raise ConfigError(FILE, number.key, after, problem, remedy)
    return Way(number, before, after, start, goal, begin, over)


def _spread(value: Any, unset: Any) -> tuple[float, ...] | None:
    value = unset if value is None or value == () else value
    if value is None:
        return None
    return (float(value),) if isinstance(value, int | float) else tuple(map(float, value))
