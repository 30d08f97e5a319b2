"""Classes by name: ours, those of installed packages, and the user's own by dotted path."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Generic, TypeVar

from protocol.errors import ConfigError, UnknownNameError

Base = TypeVar("Base")


@dataclass(frozen=True)
class Plugins(Generic[Base]):
    """A kind of classes that configs name.

    Attributes:
        group: of entry points, such as "hoap3.controllers".
        kind: in messages, such as "controller".
        base: what each derives from.
        builtin: ours, as "module:Class" by name.
        guide: a page that helps with writing one, as the end of a message; "" for none.
    """

    group: str
    kind: str
    base: type[Base]
    builtin: Mapping[str, str]
    guide: str = ""

    def registered(self) -> dict[str, EntryPoint]:
        """Everything that can be named: ours, then what installed packages offer."""
        found = {name: EntryPoint(name, value, self.group) for name, value in self.builtin.items()}
        for point in entry_points(group=self.group):
            found.setdefault(point.name, point)
        return found

    def find(self, name: str, file: str = "config", key: str = "") -> type[Base]:
        """A class.

        Args:
            name: registered, or a dotted path `package.module:Class`.
            file, key: where it was named, for errors.

        Raises:
            UnknownNameError: nobody registered it.
            ConfigError: it cannot be imported, or is none of this kind.
        """
        known = self.registered()
        key = key or self.kind
        if name in known:
            point = known[name]
        elif ":" in name:
            point = EntryPoint(name, name, self.group)
        else:
            hint = f" ({file}: {key}; your own is named package.module:Class)"
            raise UnknownNameError(self.kind, name, known, hint)
        return self._checked(_load(point, name, file, key), name, file, key)

    def _checked(self, loaded: object, name: str, file: str, key: str) -> type[Base]:
        if not (inspect.isclass(loaded) and issubclass(loaded, self.base)):
            raise ConfigError(
                file,
                key,
                name,
                f"is not a {self.kind} class",
                f"Derive it from {self.base.__module__}.{self.base.__qualname__}",
            )
        missing = sorted(getattr(loaded, "__abstractmethods__", ()))
        if missing:
            raise ConfigError(
                file, key, name, f"lacks the method {', '.join(missing)}", f"Define it{self.guide}"
            )
        return loaded


def load_function(name: str, file: str, key: str) -> Callable[..., Any]:
    """A user's function by dotted path `package.module:function`.

    Raises:
        ConfigError: it cannot be imported, or cannot be called.
    """
    if ":" not in name:
        raise ConfigError(file, key, name, "is no dotted path", "Write package.module:function")
    loaded: Callable[..., Any] = _load(EntryPoint(name, name, ""), name, file, key)
    if not callable(loaded):
        raise ConfigError(file, key, name, "cannot be called", "Name a function")
    return loaded


def _load(point: EntryPoint, name: str, file: str, key: str) -> Any:
    try:
        return point.load()
    except Exception as error:
        raise ConfigError(
            file,
            key,
            name,
            f"cannot be imported: {blame(error)}",
            "Install its package, or keep its module beside the config file",
        ) from error


def blame(error: Exception, owner: type | None = None) -> str:
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
