"""Controllers by name: ours, those of installed packages, and the user's own by dotted path."""

from __future__ import annotations

import importlib
import inspect
import traceback
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from protocol.errors import ConfigError, UnknownNameError
from remote_controller.controllers.controller import Controller

GROUP = "hoap3.controllers"
BUILTIN = {
    "qp12": "remote_controller.controllers.qp12:Qp12Controller",
    "pinv": "remote_controller.controllers.pinv:PinvController",
    "osqp": "remote_controller.controllers.osqp:OsqpController",
}


def registered() -> dict[str, EntryPoint]:
    """Every controller that can be named: ours, then those of installed packages."""
    found = {name: EntryPoint(name, value, GROUP) for name, value in BUILTIN.items()}
    for point in entry_points(group=GROUP):
        found.setdefault(point.name, point)
    return found


def is_registered(name: str) -> bool:
    """Whether a name, rather than a dotted path, leads to a controller."""
    return name in registered()


def find(name: str, file: str = "config", key: str = "controller") -> type[Controller]:
    """The class of a controller.

    Args:
        name: registered, or a dotted path `package.module:Class`.
        file, key: where it was named, for errors.

    Raises:
        UnknownNameError: nobody registered it.
        ConfigError: it cannot be imported, or is not a controller.
    """
    known = registered()
    if name in known:
        point = known[name]
    elif ":" in name:
        point = EntryPoint(name, name, GROUP)
    else:
        hint = f" ({file}: {key}; your own is named package.module:Class)"
        raise UnknownNameError("controller", name, known, hint)
    try:
        loaded = point.load()
    except (Exception, SystemExit) as error:  # nobody else may end us
        raise ConfigError(
            file,
            key,
            name,
            f"cannot be imported: {blame(error)}",
            "Install its package, or keep its module beside the config file",
        ) from error
    return _checked(loaded, name, file, key)


def _checked(loaded: object, name: str, file: str, key: str) -> type[Controller]:
    if not (inspect.isclass(loaded) and issubclass(loaded, Controller)):
        raise ConfigError(
            file,
            key,
            name,
            "is not a controller class",
            "Derive it from remote_controller.controllers.controller.Controller",
        )
    missing = sorted(loaded.__abstractmethods__)
    if missing:
        raise ConfigError(
            file,
            key,
            name,
            f"lacks the method {', '.join(missing)}",
            "Define it; docs/writing_a_controller.md has an example",
        )
    return loaded


def blame(error: BaseException, controller: type | None = None) -> str:
    """What somebody else's code raised, and where, in one line; rather in the controller's file."""
    home = inspect.getmodule(controller)
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


def module_of(controller: type[Controller]) -> str:
    """Where a controller comes from, for the log."""
    return f"{importlib.import_module(controller.__module__).__name__}:{controller.__qualname__}"
