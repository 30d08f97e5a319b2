"""Functions that users name by dotted path."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import EntryPoint
from typing import Any

from hoap3.protocol.config.plugins import blame
from hoap3.protocol.config.user_code import before_import
from hoap3.protocol.errors import ConfigError


def load_function(name: str, key: str) -> Callable[..., Any]:
    """A function by dotted path `package.module:function`.

    Args:
        name: the dotted path.
        key: where it was named, for errors.

    Raises:
        ConfigError: with file "": it cannot be imported, may not be, or cannot be called.
    """
    if ":" not in name:
        raise ConfigError("", key, name, "is no dotted path", "Write package.module:function")
    before_import(name, "", key)
    try:
        loaded: Callable[..., Any] = EntryPoint(name, name, "").load()
    except Exception as error:
        problem = f"cannot be imported: {blame(error)}"
        remedy = "Install its package, or keep its module beside the config file"
        raise ConfigError("", key, name, problem, remedy) from error
    if not callable(loaded):
        raise ConfigError("", key, name, "cannot be called", "Name a function")
    return loaded
