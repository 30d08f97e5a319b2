"""Tells that kernels are being compiled: the first start of a version takes a minute."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hoap3.tools.show.output import Meter


def watch_compilation(tell: Callable[[str], None] | None = None) -> None:
    """Have it told which kernel is compiled next; one that comes from the cache is not.

    Args:
        tell: takes its name; None: lines on standard error, the first after 2 s.
    """
    from numba.core import event  # it takes a second

    say = tell or Meter("compiling kernels, once for each version", None).step

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            say(event.data["dispatcher"].py_func.__name__)

        def on_end(self, event: Any) -> None:
            """Nothing is told of an end."""

    event.register("numba:compile", Listener())  # type: ignore[no-untyped-call]
