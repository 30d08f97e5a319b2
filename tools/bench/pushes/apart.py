"""A push in a process of its own, for a solver that may never return."""

from __future__ import annotations

import multiprocessing
import resource
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from hoap3.protocol.errors import Hoap3Error

LONGEST_S = 60  # of CPU, for a push that takes some 10 s where the solver answers


def answer_within(limit_s: int, ask: Callable[..., bool], *given: Any) -> bool | None:
    """What a function says; None where it takes too long, and is ended.

    Args:
        limit_s: CPU time that it has, the start of its process included [s].
        ask, given: a function of a module, and what it is called with.

    Raises:
        Hoap3Error: it died.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=_answer, args=(theirs, limit_s, ask, given), daemon=True)
    child.start()
    theirs.close()
    with ours:
        try:
            found: bool = ours.recv()
        except EOFError as error:
            child.join()
            if child.exitcode == -signal.SIGXCPU:
                return None
            raise Hoap3Error(f"a process of a peer ended with code {child.exitcode}") from error
    child.join()
    return found


def _answer(
    theirs: Connection, limit_s: int, ask: Callable[..., bool], given: tuple[Any, ...]
) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, resource.RLIM_INFINITY))
    theirs.send(bool(ask(*given)))
