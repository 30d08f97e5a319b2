"""Classes by name: ours, those of installed packages, and the user's own by dotted path."""

from __future__ import annotations

import inspect
import re
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hoap3.protocol.config.dotted_keys import join_key
from hoap3.protocol.config.settings import Settings
from hoap3.protocol.config.user_code import before_import
from hoap3.protocol.errors import (
    ConfigError,
    FrameNotFoundError,
    Hoap3Error,
    UnknownNameError,
    located,
)
from hoap3.protocol.former_names import find_former_method, find_former_name

if TYPE_CHECKING:
    from hoap3.protocol.robot.description import RobotDescription

_DOTTED = re.compile(r"\w+(\.\w+)*:\w+(\.\w+)*")


@dataclass(frozen=True)
class PluginGroup:
    """Classes that share an entry-point group and a base.

    Attributes:
        kind: what one of them is called in errors.
        group: entry-point group that installed packages register theirs in.
        builtin: ours, name to `module:Class`.
        bases: dotted paths of the classes that one of them must derive from; resolved on use.
        guide: topic of `hoap3 help` that shows how to write one.
    """

    kind: str
    group: str
    builtin: Mapping[str, str]
    bases: tuple[str, ...]
    guide: str

    def registered(self) -> dict[str, EntryPoint]:
        """Everything that can be named: ours, then those of installed packages."""
        found = {name: EntryPoint(name, value, self.group) for name, value in self.builtin.items()}
        for point in entry_points(group=self.group):
            found.setdefault(point.name, point)
        return found

    def find(self, name: str, file: str = "config", key: str = "") -> Any:
        """A class of this family.

        Args:
            name: registered, or a dotted path `package.module:Class`.
            file, key: where it was named, for errors; the key is the kind by default.

        Raises:
            UnknownNameError: nobody registered it.
            ConfigError: it was renamed, cannot be imported, may not be (see `user_code`), or does
                not belong to the family.
        """
        key = key or self.kind
        if name in self.builtin:
            point = EntryPoint(name, self.builtin[name], self.group)
        elif name in (known := self.registered()):
            point = known[name]
        elif ":" in name:
            if not _DOTTED.fullmatch(name):
                remedy = "Write package.module:Class; settings stand in a file, which is named"
                raise ConfigError(file, key, name, "is no dotted path of a class", remedy)
            before_import(name, file, key)
            point = EntryPoint(name, name, self.group)
        elif former := find_former_name(self.kind, name):
            raise ConfigError(file, key, name, former.problem, former.remedy)
        else:
            hint = f" ({file}: {key}; your own is named package.module:Class)"
            raise UnknownNameError(self.kind, name, known, hint)
        try:
            loaded = point.load()
        except (Exception, SystemExit) as error:  # nobody else may end us
            problem = f"cannot be imported: {blame(error)}"
            remedy = "Install its package, keep its module next to the config, or be in its folder"
            raise ConfigError(file, key, name, problem, remedy) from error
        return self._checked(loaded, name, file, key)

    def _checked(self, loaded: Any, name: str, file: str, key: str) -> type[Any]:
        bases = tuple(EntryPoint("", base, self.group).load() for base in self.bases)
        if not (inspect.isclass(loaded) and issubclass(loaded, bases)):
            remedy = f"Derive it from {' or '.join(self.bases).replace(':', '.')}"
            raise ConfigError(file, key, name, f"is not a {self.kind} class", remedy)
        missing = sorted(getattr(loaded, "__abstractmethods__", ()))
        if missing:
            problem = f"lacks the method {', '.join(missing)}"
            remedy = f"Define it; `hoap3 help {self.guide}` has an example"
            raise ConfigError(file, key, name, problem, remedy)
        if hasattr(loaded, "apply") and (former := find_former_method(loaded)):
            problem = f"has the method {former.old}, which {former.problem}"
            raise ConfigError(
                file, key, name, problem, f"{former.remedy} (`hoap3 help configuration`)"
            )
        return loaded


def blame(error: BaseException, owner: type | None = None) -> str:
    """What somebody else's code raised, and where, in one line; rather in the owner's file."""
    home = inspect.getmodule(owner)
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename != __file__ and "importlib" not in frame.filename
    ]
    at_home = [frame for frame in frames if frame.filename == getattr(home, "__file__", None)]
    place = "".join(
        f" ({Path(frame.filename).name}, line {frame.lineno})" for frame in (at_home or frames)[-1:]
    )
    return " ".join(f"{type(error).__name__}: {error}{place}".split())


@contextmanager
def building(
    owner: type,
    name: str,
    robot: RobotDescription,
    given: Settings,
    file: str,
    key: str,
    below: str,
) -> Iterator[None]:
    """Have whatever goes wrong while a class is built for a robot be told as an error of a config.

    Args:
        owner, name: the class, and what the config calls it.
        robot, given: what it is built for, and its parameters.
        file, key, below: where its name stands, and its parameters.

    Raises:
        ConfigError: naming the file, the key and the value.
    """
    try:
        with located(file, below):
            yield
    except FrameNotFoundError as error:
        path = join_key(_path_to(error.frame, given.model_dump()))
        where = ".".join(filter(None, (below, path)))
        problem = f"robot {robot.name!r} has no such frame"
        remedy = f"Its frames: {', '.join(error.known)}"
        raise ConfigError(file, where, error.frame, problem, remedy) from error
    except Hoap3Error:
        raise
    except (Exception, SystemExit) as error:  # nobody else may end us
        problem = f"cannot be built for robot {robot.name!r} with {robot.n} joints"
        remedy = "Correct it, or choose a robot that it is made for"
        raise ConfigError(file, key, name, f"{problem}: {blame(error, owner)}", remedy) from error


def _path_to(value: object, content: object) -> list[str]:
    """Keys under which a value stands in nested settings; none if it does not."""
    if isinstance(content, Mapping):
        parts = [(str(key), inner) for key, inner in content.items()]
    elif isinstance(content, list | tuple):
        parts = [(str(place), inner) for place, inner in enumerate(content)]
    else:
        return []
    for key, inner in parts:
        if inner == value:
            return [key]
        path = _path_to(value, inner)
        if path:
            return [key, *path]
    return []
