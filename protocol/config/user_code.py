"""Code that a config names by dotted path: whether it may be imported, and who is told before.

By default it may: whoever starts a controller orders its code to run. A command that only looks at
a config, or that reads a log, takes `user_code(allowed=False)`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path

from hoap3.protocol.errors import ConfigError


@dataclass
class UserCode:
    """A rule, and what it was asked for.

    Attributes:
        allowed: code that a config names by dotted path may be imported.
        say: is told before the first import of each name.
        names: the dotted paths that were asked for.
    """

    allowed: bool = True
    say: Callable[[str], None] | None = None
    names: list[str] = field(default_factory=list)


_RULE: ContextVar[UserCode | None] = ContextVar("user_code", default=None)


@contextmanager
def user_code(*, allowed: bool, say: Callable[[str], None] | None = None) -> Iterator[UserCode]:
    """Inside it, code by dotted path is imported only if `allowed`, and `say` is told before."""
    rule = UserCode(allowed, say)
    token = _RULE.set(rule)
    try:
        yield rule
    finally:
        _RULE.reset(token)


@contextmanager
def code_of_log(*, allowed: bool) -> Iterator[UserCode]:
    """`user_code` of a log; where allowed, the current folder joins the end of the import path."""
    here = str(Path.cwd())
    if allowed and here not in sys.path:
        sys.path.append(here)
    with user_code(allowed=allowed) as rule:
        yield rule


def may_import() -> bool:
    """Whether code that a config names may be imported."""
    rule = _RULE.get()
    return rule is None or rule.allowed


def before_import(name: str, file: str, key: str) -> None:
    """To be called before code is imported by dotted path.

    Args:
        name: the dotted path.
        file, key: where it was named, for the error.

    Raises:
        ConfigError: it may not be imported.
    """
    rule = _RULE.get()
    if rule is None:
        return
    known = name in rule.names
    if not known:
        rule.names.append(name)
    if not rule.allowed:
        problem, remedy = "names code that would be imported, and so run", "If you trust it, add"
        raise ConfigError(file, key, name, problem, f"{remedy} --allow-code")
    if rule.say is not None and not known:
        rule.say(f"{file or 'config'}: {key}: imports {name}, which runs its module")
