"""Tells that kernels are being compiled: the first start of a version takes a minute."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import event

from hoap3.tools.show.output import Meter


class _Listener(event.Listener):
    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell

    def on_start(self, event: Any) -> None:
        self._tell(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: Any) -> None:
        """Nothing is told of an end."""


def watch_compilation(tell: Callable[[str], None] | None = None) -> None:
    """Have it told which kernel is compiled next; one that comes from the cache is not.

    Args:
        tell: takes its name; None: lines on standard error, the first after 2 s.
    """
    if tell is None:
        tell = Meter("compiling kernels, once for each version", None).step
    event.register("numba:compile", _Listener(tell))  # type: ignore[no-untyped-call]
